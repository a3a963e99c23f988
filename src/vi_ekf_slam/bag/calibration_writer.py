"""Copy a bag and put a calibration into the copy: /tf_static and one camera_info of each camera at its beginning, latched."""

import rosbag

from vi_ekf_slam.bag import messages as make
from vi_ekf_slam.bag.connections import STATIC_TOPIC, latched
from vi_ekf_slam.bag.limits import require_bounded_chunks
from vi_ekf_slam.bag.opening import open_bag
from vi_ekf_slam.common.checks import require_distinct
from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.output_file import replacing


def add_calibration(options, rig):
    """Write options.output; (messages written, messages of camera_info left out).

    options: bag, output, imu_topic, imu_frame (None: that of the bag), left_frame, right_frame, left_info, right_info.
    rig: RigCalibration.
    """
    replaced = 0
    with open_bag(options.bag) as source:
        require_bounded_chunks(source, options.bag)
        if not source.get_message_count():
            raise InputError("%s: holds no messages" % options.bag)
        imu_frame = options.imu_frame or _imu_frame(source, options)
        require_distinct([imu_frame, options.left_frame, options.right_frame])
        _refuse_second_parent(source, options)
        stamp = next(iter(source.read_messages(raw=True)))[2]
        with replacing(options.output) as stream:
            target = rosbag.Bag(stream, "w")
            for topic, message in _own(rig, options, imu_frame, stamp):
                target.write(topic, message, stamp, connection_header=latched(topic, message))
            count = 3
            for topic, message, time, header in source.read_messages(raw=True, return_connection_header=True):
                if topic in (options.left_info, options.right_info):
                    replaced += 1
                    continue
                target.write(topic, message, time, raw=True, connection_header=header)
                count += 1
            target.close()
    return count, replaced


def _own(rig, options, imu_frame, stamp):
    yield STATIC_TOPIC, make.rig_transforms(stamp, rig.imu_T_left, rig.left_T_right, imu_frame, options.left_frame,
                                            options.right_frame)
    yield options.left_info, make.camera_info(stamp, options.left_frame, rig.left)
    yield options.right_info, make.camera_info(stamp, options.right_frame, rig.right)


def _imu_frame(bag, options):
    for _, message, _ in bag.read_messages([options.imu_topic]):
        frame = getattr(getattr(message, "header", None), "frame_id", "").lstrip("/")
        if not frame:
            raise InputError("%s: header.frame_id on %s is empty, allowed: a frame (--imu-frame gives one, but the node needs "
                             "it in the messages)" % (options.bag, options.imu_topic))
        return frame
    raise InputError("%s: nothing is on %s, allowed: --imu-topic TOPIC or --imu-frame FRAME; the bag has %s"
                     % (options.bag, options.imu_topic, ", ".join(sorted(bag.get_type_and_topic_info().topics)) or "nothing"))


def _refuse_second_parent(bag, options):
    ours = {options.left_frame, options.right_frame}
    for _, message, _ in bag.read_messages([STATIC_TOPIC]):
        children = {transform.child_frame_id.lstrip("/"): transform.header.frame_id for transform in message.transforms}
        for child in sorted(ours & set(children)):
            raise InputError("%s: %s already has %s -> %s, allowed: other frames (--left-frame, --right-frame)"
                             % (options.bag, STATIC_TOPIC, children[child], child))
