"""What a dataset holds, in a few lines of text."""

import numpy as np


def describe_extrinsic(dataset):
    """One sentence on the extrinsic's key and reading."""
    if dataset.extrinsic_key is None:
        return "none in the file"
    translation = "(%.4f, %.4f, %.4f) m" % tuple(dataset.cam_T_imu[:3, 3])
    if dataset.extrinsic_repaired:
        return ("cam_T_imu, repaired: its last column is the camera's position in IMU axes, so the translation of "
                "cam_T_imu is -R t = %s (--extrinsic given takes the file at its word)" % translation)
    return "%s, taken as given: translation of cam_T_imu %s" % (dataset.extrinsic_key, translation)


def describe_stale(repair, repaired):
    """One sentence on stale frames. repair: of stale.assign_ids; repaired: whether ids were renewed."""
    count = len(repair.stale_frames)
    if count == 0:
        return "0"
    if repaired:
        return "%d repaired, %d tracks given a new id (--keep-stale leaves them)" % (count, repair.restarted_tracks)
    return "%d left as they are (--keep-stale)" % count


def track_lengths(ids):
    """Number of frames per track, for all ids in (M, T); -1 marks unseen."""
    return np.unique(ids[ids >= 0], return_counts=True)[1]


def summarise(dataset, repair, repaired):
    """The report as a list of lines. repair: of stale.assign_ids, or None when the dataset was read without features."""
    lines = [
        "drive: %s" % dataset.name,
        "frames: %d in %.3f s, %.2f Hz" % (dataset.frames, dataset.duration, (dataset.frames - 1) / dataset.duration),
        "distance: %.1f m by dead reckoning"
        % np.sum(np.diff(dataset.stamps) * np.linalg.norm(dataset.linear_velocity[:, :-1], axis=0)),
        "extrinsic: %s" % describe_extrinsic(dataset),
    ]
    if repair is None:
        return lines + ["features: left out"]
    per_frame = dataset.seen.sum(axis=0)
    lengths = track_lengths(repair.ids)
    lines.append("features: %d to %d a frame, median %g; %d observations rejected (some but not all pixels -1)"
                 % (per_frame.min(), per_frame.max(), np.median(per_frame), dataset.partial))
    if len(lengths):
        lines.append("tracks: %d, %d to %d frames long, median %g"
                     % (len(lengths), lengths.min(), lengths.max(), np.median(lengths)))
    else:
        lines.append("tracks: 0")
    lines.append("stale frames: %s" % describe_stale(repair, repaired))
    return lines
