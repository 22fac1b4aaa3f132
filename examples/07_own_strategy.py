"""A strategy of one's own in one class: touch the object from above on a grid of places."""

from math import e

import numpy as np

import lwrprobe as lp

SAMPLES = 10  # of each contact; the first three are not stored, the sphere still slips


class TouchGrid:
    """Go above a place, down until there is a contact, hold the force, up again, then to the next place."""

    def start(self, task):
        self.task = task
        low, high = 0.2 * task.area.lower[:2], 0.2 * task.area.upper[:2]
        self.places = [(x, y) for x in np.linspace(low[0], high[0], 4) for y in np.linspace(low[1], high[1], 3)]
        self.phase, self.samples = "up", 0

    def step(self, seen):
        top, bottom = self.task.area.upper[2], self.task.area.lower[2]
        if self.phase == "down" and seen.contact is not None:
            self.phase, self.samples = "hold", 0
        if self.phase == "hold":
            self.samples += 1
            if seen.contact is not None and self.samples < SAMPLES:
                force = float(seen.force @ seen.contact.normal)
                damping = e * self.task.delay * self.task.stiffness
                return lp.VelocityCommand((force - self.task.force_target) / damping * seen.contact.normal)
        if self.phase == "hold" or (self.phase == "down" and seen.goal_reached):
            self.phase = "up"
            self.places.pop(0)
        elif self.phase == "up" and seen.pose[2, 3] > top - 1e-4:
            self.phase = "across"
        elif self.phase == "across" and seen.goal_reached:
            self.phase = "down"
        if not self.places and self.phase == "across":
            return lp.Done("all places touched")
        place = seen.pose[:2, 3] if self.phase == "up" else self.places[0]
        slow = min(self.task.approach_speed, 0.005)  # m/s, the stick is stiff along its axis
        return self.goal(place, bottom if self.phase == "down" else top, slow if self.phase == "down" else 0.1)

    def goal(self, place, height, speed):
        pose = np.eye(4)
        pose[:3, :3] = self.task.orientation
        pose[:3, 3] = *place, height
        return lp.Goal(pose, speed)


run = lp.explore("sphere", strategy=TouchGrid(), seed=7)
print(run.summary.status, "because", run.summary.reason)
print(f"{len(run.contacts)} contacts in {run.summary.sim_time_s:.0f} s, peak force {run.summary.peak_force_n:.2f} N")
print(f"the highest contact is at z = {1e3 * run.contacts.points[:, 2].max():.1f} mm; the ball is 50 mm high")
