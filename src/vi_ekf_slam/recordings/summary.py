"""What a recorded drive holds, in a few lines of text."""

import numpy as np


def summarise_recording(recording):
    """The report as a list of lines."""
    lines = ["drive: %s" % recording.name]
    for name, stream in (("stereo pairs", recording.images), ("frames of features", recording.features),
                         ("IMU samples", recording.imu), ("velocities", recording.velocity)):
        if stream is not None:
            seconds = (stream.stamps[-1] - stream.stamps[0]) * 1e-9
            lines.append("%s: %d in %.3f s, %.2f Hz" % (name, len(stream.stamps), seconds,
                                                        (len(stream.stamps) - 1) / seconds if seconds else 0.0))
    if recording.features is not None:
        counts = np.diff(recording.features.starts)
        lines.append("features: %d to %d a frame, median %g; sigma %.2f to %.2f px"
                     % (counts.min(), counts.max(), np.median(counts), recording.features.sigmas.min(initial=np.inf),
                        recording.features.sigmas.max(initial=0.0)))
    if recording.truth is not None:
        lines.append("truth: %d poses" % len(recording.truth[0]))
    return lines + recording.notes
