"""Transforms between two frames of /tf_static, directly or as a chain."""

import numpy as np

from vi_ekf_slam.common.geometry import inverse, make_transform, quaternion_to_rotation


def root(parents, frame):
    """The frame above all of `frame`, itself where nothing is above it. parents: {child: parent}, without leading slashes."""
    seen = set()
    while frame in parents and frame not in seen:
        seen.add(frame)
        frame = parents[frame]
    return frame


def matrix_of(pose):
    """4 x 4 of a geometry_msgs/Transform or Pose; None for what is none (not finite, no unit quaternion)."""
    p, q = (pose.translation, pose.rotation) if hasattr(pose, "translation") else (pose.position, pose.orientation)
    quaternion, position = [q.x, q.y, q.z, q.w], [p.x, p.y, p.z]
    if not abs(np.linalg.norm(quaternion) - 1.0) < 1e-3 or not np.isfinite(position).all():
        return None
    return make_transform(quaternion_to_rotation(quaternion), position)


def chain(transforms, target, source):
    """target_T_source (4 x 4) through geometry_msgs/TransformStamped in either direction; None where nothing connects the frames.

    What is no transform (matrix_of) is passed over. A leading slash of a frame means nothing.
    """
    edges = {}
    for t in transforms:
        parent_T_child = matrix_of(t.transform)
        if parent_T_child is None:
            continue
        parent, child = t.header.frame_id.lstrip("/"), t.child_frame_id.lstrip("/")
        edges.setdefault(child, []).append((parent, parent_T_child))
        edges.setdefault(parent, []).append((child, inverse(parent_T_child)))
    source, target = source.lstrip("/"), target.lstrip("/")
    found, queue = {source: np.eye(4)}, [source]
    while queue:
        here = queue.pop(0)
        for there, there_T_here in edges.get(here, ()):
            if there not in found:
                found[there] = there_T_here @ found[here]
                queue.append(there)
    return found.get(target)
