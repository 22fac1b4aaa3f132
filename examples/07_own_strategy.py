"""A strategy of one's own in one class: touch the object from above on a small grid of places."""

import numpy as np

import lwrprobe as lp
from lwrprobe.contracts import STRATEGY_CONTRACT, Done, Goal, Progress


class TouchGrid:
    """Go above a place, down until there is a contact, up again, then to the next place."""

    contract = STRATEGY_CONTRACT
    line_spacing = None  # no lines
    trace = ()

    def start(self, task):
        self.task = task
        low, high = 0.6 * task.area.lower[:2], 0.6 * task.area.upper[:2]
        self.places = [(x, y) for x in np.linspace(low[0], high[0], 5) for y in np.linspace(low[1], high[1], 4)]
        self.count = len(self.places)
        self.down = False

    def step(self, seen):
        if self.down and (seen.contact is not None or seen.goal_reached):
            self.down = False
            self.places.pop(0)
            return self.goal(seen.pose[:2, 3], self.task.area.upper[2], self.task.free_speed)
        if not self.places:
            return Done("all places touched")
        if not self.down and seen.goal_reached and np.allclose(seen.pose[:2, 3], self.places[0], atol=1e-4):
            self.down = True
        low, high = self.task.area.lower[2], self.task.area.upper[2]
        if self.down:
            return self.goal(self.places[0], low, 0.5 * self.task.approach_speed)
        above = seen.pose[2, 3] > high - 1e-4
        return self.goal(self.places[0] if above else seen.pose[:2, 3], high, self.task.free_speed)

    def goal(self, place, height, speed):
        pose = np.eye(4)
        pose[:3, :3] = self.task.orientation
        pose[:3, 3] = *place, height
        return Goal(pose, speed)

    def progress(self):
        return Progress("touching", 1.0 - len(self.places) / self.count)


run = lp.explore("sphere", strategy=TouchGrid(), seed=7)
print(run.summary.status, "because", run.summary.reason)
points = run.contacts.points
print(f"{len(points)} contacts, the highest at z = {1e3 * points[:, 2].max():.1f} mm (the ball is 50 mm high)")
