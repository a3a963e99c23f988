"""Motion between two frames by bundle adjustment of stereo points of the first and the left picture of the second.

Points that are triangulated once and then held (PnP) carry the noise of their disparities. It attenuates the translation, as any
regression on noisy regressors is attenuated (errors in variables), and turns part of the rest into rotation: at a baseline of 0.05 m,
points 2 to 6 m away and 0.5 px the way came out 0.85 of what it was. Where points are unknowns too, no residual is preferred and the
estimate is consistent, noise of all pixels being alike (total least squares).
"""

import numpy as np

from vi_ekf_slam.common.geometry import so3_exp

ITERATIONS, SMALL = 30, 0.03  # of its standard deviation: a step after which there is no more to gain
OUTLIER = 3.0  # sigma, of the three residuals of a point together: what has no fault loses 3 %
MEDIAN_OF_CHI_SQUARE = 2.37  # with the three degrees of a point: six pixels (four, of a corner) of three unknowns (one)
CORNER = 10.0  # weight of what has no noise beside what has
# (uL, vL, uR, vR) of (u, v, disparity).
STEREO = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def refine(K, baseline, before, after, motion, agree, exact=False):
    """(after_R_before (3, 3), translation (3,) m, rotation's standard deviation rad, which points agree (N,)) of Gauss-Newton.

    K (3, 3) of both rectified pictures; baseline m; before (N, 4) px: uL vL uR vR; after (N, 2) px; motion: (after_R_before,
    translation) to start from; agree (N,): points that fit it. exact: the points are corners of the first left picture, where
    they are without noise, matched with the others. None where fewer than six do. The translation is NaN
    where it does not converge: where disparities are hardly above their noise any length of it fits.
    """
    weights = np.array([CORNER, CORNER, 1.0, 1.0]) if exact else np.ones(4)
    stereo, before_weighted = weights[:, None] * STEREO, weights * before
    focal, centre = K[[0, 1], [0, 1]], K[:2, 2]
    rotation, translation = motion
    points = np.column_stack([before[:, 0], 0.5 * (before[:, 1] + before[:, 3]), before[:, 0] - before[:, 2]])
    for _ in range(ITERATIONS):
        with np.errstate(divide="ignore", invalid="ignore"):
            seen, by_point, by_motion = _predict(focal, centre, baseline, points, rotation, translation)
            residual_before, residual = before_weighted - points @ stereo.T, after - seen
        point_information = stereo.T @ stereo + np.einsum("nki,nkj->nij", by_point, by_point)
        cross = np.einsum("nki,nkj->nij", by_point, by_motion)
        gradient = residual_before @ stereo + np.einsum("nki,nk->ni", by_point, residual)
        solved = np.linalg.solve(point_information, np.concatenate([cross, gradient[:, :, None]], axis=2))
        # Squared residuals at the points that fit this motion best.
        cost = np.sum(residual_before**2, axis=1) + np.sum(residual**2, axis=1) - np.einsum("ni,ni->n", gradient, solved[:, :, 6])
        variance = np.median(cost[agree]) / MEDIAN_OF_CHI_SQUARE
        agree = cost < OUTLIER**2 * variance
        if agree.sum() < 6:
            return None
        information = (np.einsum("nki,nkj->ij", by_motion[agree], by_motion[agree])
                       - np.einsum("nki,nkj->ij", cross[agree], solved[agree][:, :, :6]))
        step = np.linalg.pinv(information) @ (np.einsum("nki,nk->i", by_motion[agree], residual[agree])
                                              - np.einsum("nki,nk->i", cross[agree], solved[agree][:, :, 6]))
        rotation, translation = so3_exp(step[:3]) @ rotation, translation + step[3:]
        points = points + solved[:, :, 6] - solved[:, :, :6] @ step
        if step @ information @ step < SMALL**2 * variance:
            break
    else:
        translation = np.full(3, np.nan)
    return rotation, translation, float(np.sqrt(variance * np.trace(np.linalg.pinv(information)[:3, :3]))), agree


def _predict(focal, centre, baseline, points, rotation, translation):
    """(px (N, 2), its derivatives by the points (N, 2, 3) and by the motion (N, 2, 6): rotation vector on the left, translation).

    points (N, 3) px: (u, v, disparity). A point is at depth f b / disparity on the ray of (u, v), so that up to that factor it is
    R ray + t disparity / (f b) in the second frame, also at infinity.
    """
    nearness = points[:, 2] / (focal[0] * baseline)  # 1/m
    turned = np.column_stack([(points[:, :2] - centre) / focal, np.ones(len(points))]) @ rotation.T
    x, y, z = (turned + nearness[:, None] * translation).T
    by_ray = np.zeros((len(points), 2, 3))
    by_ray[:, 0, 0], by_ray[:, 0, 2] = focal[0] / z, -focal[0] * x / z**2
    by_ray[:, 1, 1], by_ray[:, 1, 2] = focal[1] / z, -focal[1] * y / z**2
    by_point = by_ray @ np.column_stack([rotation[:, :2] / focal, translation / (focal[0] * baseline)])
    by_motion = np.empty((len(points), 2, 6))
    for k in range(3):  # the cross product of turned and by_ray, written out: np.cross takes several times as long
        i, j = (k + 1) % 3, (k + 2) % 3
        by_motion[:, :, k] = turned[:, i, None] * by_ray[:, :, j] - turned[:, j, None] * by_ray[:, :, i]
    by_motion[:, :, 3:] = nearness[:, None, None] * by_ray
    return np.column_stack([x / z, y / z]) * focal + centre, by_point, by_motion
