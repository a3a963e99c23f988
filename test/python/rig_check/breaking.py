"""What breaks a rig: each takes the entries of rigs.message_list, changes them in place or leaves some out, and returns them."""

import genpy
import numpy as np
import rigs

from vi_ekf_slam.common.geometry import make_transform, quaternion_to_rotation, rotation_to_quaternion


def extrinsic(entries, imu_T_left):
    """Another transform from the IMU to the left camera."""
    transform = rigs.of(entries, "/tf_static")[0][2].transforms[0].transform
    transform.rotation.x, transform.rotation.y, transform.rotation.z, transform.rotation.w = rotation_to_quaternion(imu_T_left[:3, :3])
    transform.translation.x, transform.translation.y, transform.translation.z = imu_T_left[:3, 3]
    return entries


def imu_T_left(entries):
    """What /tf_static says, 4 x 4."""
    transform = rigs.of(entries, "/tf_static")[0][2].transforms[0].transform
    q, p = transform.rotation, transform.translation
    return make_transform(quaternion_to_rotation([q.x, q.y, q.z, q.w]), [p.x, p.y, p.z])


def gyro(entries, change):
    for _, _, message in rigs.of(entries, "/imu"):
        w = message.angular_velocity
        w.x, w.y, w.z = (float(x) for x in change(np.array([w.x, w.y, w.z])))
    return entries


def accelerations(entries, change):
    for _, _, message in rigs.of(entries, "/imu"):
        a = message.linear_acceleration
        a.x, a.y, a.z = (float(x) for x in change(np.array([a.x, a.y, a.z])))
    return entries


def turned_imu(entries, turn):
    return accelerations(gyro(entries, lambda w: turn @ w), lambda a: turn @ a)


def features(entries, change):
    for _, _, message in rigs.of(entries, "/features"):
        for f in message.features:
            change(f)
    return entries


def exchanged(f):
    f.u_left, f.u_right, f.v_left, f.v_right = f.u_right, f.u_left, f.v_right, f.v_left


def other_rows(f):
    f.v_right += 0.02 * (f.u_right - 320.0) + 3.0  # a camera that is rolled and pitched


def infos(entries, change):
    left, right = (rigs.of(entries, "/%s/camera_info" % side) for side in ("left", "right"))
    for (_, _, a), (_, _, b) in zip(left, right):
        change(a, b)
    return entries


def exchange_infos(left, right):
    left.P, right.P = right.P, left.P


def scale_baseline(factor):
    def change(_, right):
        right.P = [p * factor if k == 3 else p for k, p in enumerate(right.P)]
    return change


def half_resolution(left, right):
    for info in (left, right):
        info.K, info.P = ([0.5 * x if k < 8 and x != 1.0 else x for k, x in enumerate(m)] for m in (info.K, info.P))
        info.width, info.height = info.width // 2, info.height // 2


def matrices_of_half_resolution(left, right):
    half_resolution(left, right)
    for info in (left, right):
        info.width, info.height = 2 * info.width, 2 * info.height


def wrong_focal_length(left, right):
    for info in (left, right):
        info.P = [0.5 * x if k in (0, 3, 5) else x for k, x in enumerate(info.P)]


def not_a_pair(left, _):
    left.P = [p + 3.0 if k == 2 else p for k, p in enumerate(left.P)]


def with_P(side, **values):
    """Other elements of P, by name: P3=1.0."""
    def change(left, right):
        info = left if side == "left" else right
        info.P = [values.get("P%d" % k, p) for k, p in enumerate(info.P)]
    return change


def one_above_the_other(_, right):
    right.P = [right.P[3] if k == 7 else 0.0 if k == 3 else p for k, p in enumerate(right.P)]


def sent_twice(entries, *topics):
    """Again half of a period later, with a stamp of that time."""
    again = rigs.copies(rigs.of(entries, *topics))
    for entry in again:
        entry[1] = entry[1] + genpy.Duration(nsecs=50000000)
        entry[2].header.stamp = entry[2].header.stamp + genpy.Duration(nsecs=50000000)
    return entries + again


def two_imus(entries):
    """Neither of which has the usual name."""
    return renamed(entries, "/imu", "/imu_1") + [["/imu_2", *entry[1:]] for entry in rigs.of(entries, "/imu_1")]


def foreign_gyro(entries):
    """The rates of a body that moves otherwise."""
    for k, (_, _, message) in enumerate(rigs.of(entries, "/imu")):
        w, t = message.angular_velocity, k / rigs.NOISE.rate
        w.x, w.y, w.z = 0.5 * np.sin(5.1 * t), 0.4 * np.sin(4.3 * t + 1.0), 0.6 * np.sin(3.7 * t + 2.0)
    return entries


def every(entries, n, change, topic="/imu"):
    for k, (_, _, message) in enumerate(rigs.of(entries, topic)):
        if k % n == 0:
            change(message)
    return entries


def not_a_number(message):
    message.linear_acceleration.y = float("nan")


def repeated(entries):
    found = rigs.of(entries, "/imu")
    for before, after in list(zip(found[:-1], found[1:]))[::5]:
        after[2].header.stamp = before[2].header.stamp
    return entries


def looping(entries):
    """The same again, stamps and all, as of a bag that loops."""
    again = rigs.copies(rigs.without(entries, "/tf"))
    for entry in again:
        entry[1] = entry[1] + genpy.Duration(int(rigs.DURATION))
    return entries + again


def burst(entries):
    """Stamped on arrival: four samples of the IMU come at a time."""
    found = rigs.of(entries, "/imu")
    for k, (_, _, message) in enumerate(found):
        last = found[min(len(found) - 1, k - k % 4 + 3)][1]
        message.header.stamp = last + genpy.Duration(nsecs=50000 * (k % 4))
    return entries


def losing(entries):
    """The IMU is away for 0.4 s of each second."""
    return [entry for entry in entries if entry[0] != "/imu" or entry[2].header.stamp.nsecs > 4e8]


def losing_some(entries):
    """The IMU is away for 0.03 s of each half."""
    return [entry for entry in entries if entry[0] != "/imu" or entry[2].header.stamp.nsecs % 500000000 > 30000000]


def no_stamp(entries, topic="/features"):
    return every(entries, 1, lambda message: setattr(message.header, "stamp", genpy.Time()), topic)


def late(entries, topic, delay):
    """Received later, by a time that grows."""
    first = entries[0][1].to_sec()
    for entry in rigs.of(entries, topic):
        entry[1] = entry[1] + genpy.Duration.from_sec(delay(entry[1].to_sec() - first))
    return entries


def renamed(entries, before, after):
    for entry in rigs.of(entries, before):
        entry[0] = after
    return entries


def one_frame(entries):
    return every(entries, 1, lambda info: setattr(info.header, "frame_id", "imu_link"), "/left/camera_info")


def backwards(entries):
    for _, _, message in rigs.of(entries, "/velocity"):
        v = message.twist.twist.linear
        v.x, v.y, v.z = -v.x, -v.y, -v.z
    return entries


def quiet_statement(entries):
    def change(message):
        message.angular_velocity_covariance = [x * 1e-4 for x in message.angular_velocity_covariance]
    return every(entries, 1, change)
