"""A remote as short as can be, by offsets from the layout, and a joint ramp without any cleverness."""

import struct

SIZE_IN, SIZE_OUT = 916, 376


def u16(data, offset):
    return struct.unpack_from("<H", data, offset)[0]


def f32(data, offset, count=1):
    return struct.unpack_from(f"<{count}f", data, offset)


def sum_of_set_points(data):
    """What a remote has to mirror."""
    return [a + b for a, b in zip(f32(data, 292, 7), f32(data, 320, 7))]


def answer(data, sequence, joints, integers=None, flags=0x0001):
    """The command that answers a measurement."""
    out = bytearray(SIZE_OUT)
    struct.pack_into("<4H", out, 0, sequence & 0xFFFF, u16(data, 0), SIZE_OUT, 0x1005)
    for index, value in (integers or {}).items():
        struct.pack_into("<i", out, 72 + 4 * index, value)
    struct.pack_into("<I", out, 140, flags)
    struct.pack_into("<7f", out, 144, *joints)
    return bytes(out)


class Remote:
    """Answers a controller's `tick` within its cycle: no sockets, no clock but the one it counts."""

    def __init__(self, controller, cycle=0.01):
        self.controller = controller
        self.cycle = cycle
        self.now = 100.0
        self.sequence = 4711
        self.data = controller.tick(self.now)

    def turn(self, joints=None, integers=None, flags=0x0001, late=False, silent=False):
        """Answer the last measurement (mirroring unless set otherwise), then take the next one."""
        data, self.sequence = self.data, self.sequence + 1
        reply = answer(data, self.sequence, sum_of_set_points(data) if joints is None else joints, integers, flags)
        if not silent and not late:
            self.controller.receive(reply, self.now + 0.001)
        self.now += self.cycle
        self.data = self.controller.tick(self.now)
        if late:
            self.controller.receive(reply, self.now + 0.001)
        return self.data

    def turns(self, count, **how):
        for _ in range(count):
            self.turn(**how)
        return self.data

    @property
    def state(self):
        return u16(self.data, 144)

    @property
    def quality(self):
        return u16(self.data, 146)

    @property
    def power(self):
        return u16(self.data, 180)

    @property
    def error(self):
        return u16(self.data, 184)

    @property
    def said(self):
        """The program's integers."""
        return struct.unpack_from("<16i", self.data, 72)

    def set_point(self):
        return sum_of_set_points(self.data)
