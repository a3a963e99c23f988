"""Smooth motions of a body as functions of time, and what an IMU on it feels. The world has z upwards; SI units."""

import numpy as np

from vi_ekf_slam.common.geometry import make_transform, so3_exp, so3_log

GRAVITY = np.array([0.0, 0.0, -9.81])
STEP = 1e-3  # s, of the central differences; the motions are sums of sines of at most some Hz, so the error is about 1e-5
REST = 2.0  # s, at the beginning
RAMP = 4.0  # s, from rest to full speed


class Laps:
    """Progress along a closed path: rest, a smooth start, then constant speed, `laps` times round in `duration` s."""

    def __init__(self, laps, duration):
        self._speed = 2.0 * np.pi * laps / (duration - REST - 0.5 * RAMP)

    def angle(self, t):
        """rad, from 0 on. The speed rises as x - sin(2 pi x) / 2 pi: twice differentiable, so no acceleration jumps."""
        x = np.clip((t - REST) / RAMP, 0.0, 1.0)
        risen = RAMP * (0.5 * x * x + (np.cos(2.0 * np.pi * x) - 1.0) / (4.0 * np.pi**2))
        return self._speed * (risen + max(0.0, t - REST - RAMP))

    def share(self, t):
        """0 at rest to 1 at full speed."""
        x = np.clip((t - REST) / RAMP, 0.0, 1.0)
        return x - np.sin(2.0 * np.pi * x) / (2.0 * np.pi)


class StreetMotion(Laps):
    """A car on an ellipse of AXES m: x forward along the street, with some roll, pitch and heave."""

    AXES, HEIGHT = (45.0, 28.0), 1.2

    def pose(self, t):
        """World_T_imu (4 x 4)."""
        a, share = self.angle(t), self.share(t)
        heading = np.arctan2(self.AXES[1] * np.cos(a), -self.AXES[0] * np.sin(a))
        sway = share * np.array([0.010 * np.sin(2.1 * t), 0.008 * np.sin(3.3 * t + 1.0), 0.0])
        position = [self.AXES[0] * np.cos(a), self.AXES[1] * np.sin(a), self.HEIGHT + 0.01 * share * np.sin(4.0 * t)]
        return make_transform(so3_exp([0, 0, heading]) @ so3_exp(sway), position)


class RoomMotion(Laps):
    """A rig held in a hand, going round in a room, looking outwards and about."""

    AXES, HEIGHT = (1.6, 1.1), 1.4

    def pose(self, t):
        """World_T_imu (4 x 4)."""
        a, share = self.angle(t), self.share(t)
        sway = share * np.array([0.12 * np.sin(1.9 * t), 0.15 * np.sin(1.3 * t + 1.0), 0.0])
        position = [self.AXES[0] * np.cos(a), self.AXES[1] * np.sin(a), self.HEIGHT + 0.15 * share * np.sin(1.1 * t)]
        return make_transform(so3_exp([0, 0, a + 0.25 * share * np.sin(0.8 * t)]) @ so3_exp(sway), position)


MOTIONS = {"street": StreetMotion, "room": RoomMotion}


def felt(motion, t):
    """(angular velocity rad/s, specific force m/s^2) of the body at t s, in its axes."""
    before, now, after = (motion.pose(t + step) for step in (-STEP, 0.0, STEP))
    rate = so3_log(before[:3, :3].T @ after[:3, :3]) / (2.0 * STEP)
    acceleration = (after[:3, 3] - 2.0 * now[:3, 3] + before[:3, 3]) / STEP**2
    return rate, now[:3, :3].T @ (acceleration - GRAVITY)


def velocity(motion, t):
    """m/s, along the world's axes."""
    return (motion.pose(t + STEP)[:3, 3] - motion.pose(t - STEP)[:3, 3]) / (2.0 * STEP)
