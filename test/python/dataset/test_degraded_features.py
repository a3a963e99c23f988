"""The ways in which degraded_bag.py makes a drive worse do what their names say."""

import numpy as np
import pytest
from conftest import dead_reckon, drive, script, se3_exp

from vi_ekf_slam.bag.degrader import main as degrade
from vi_ekf_slam.bag.reader import read_reference
from vi_ekf_slam.common.errors import InputError
from vi_ekf_slam.common.geometry import inverse
from vi_ekf_slam.dataset import degradation
from vi_ekf_slam.dataset.loader import load_dataset
from vi_ekf_slam.dataset.pose_files import tum_line
from vi_ekf_slam.dataset.stale import assign_ids
from vi_ekf_slam.dataset.synthetic_traffic import PIXEL_NOISE, add_traffic

FRAMES = 40
TWIST = np.array([8.0, 0.1, -0.05, 0.01, 0.02, 0.2])  # m/s, rad/s


@pytest.fixture
def dataset(save):
    return load_dataset(save(drive(frames=FRAMES, landmarks=40)))


@pytest.fixture
def truth(dataset):
    return dataset.stamps, np.array([se3_exp(t * TWIST) for t in dataset.stamps - dataset.stamps[0]])


@pytest.fixture
def frames(dataset):
    return degradation.frames_of(dataset, assign_ids(dataset.features, dataset.seen).ids)


def test_packing_gives_the_frames_back(dataset, frames):
    packed, ids = degradation.pack(dataset, frames)
    assert packed.features.shape[1] == max(len(i) for i, _ in frames)
    again = degradation.frames_of(packed, ids)
    assert all(np.array_equal(i, j) and np.array_equal(p, q) for (i, p), (j, q) in zip(frames, again))


def test_every_nth_track_keeps_whole_tracks(frames):
    kept = degradation.keep_tracks(frames, 4)
    before, after = (set(np.concatenate([ids for ids, _ in f])) for f in (frames, kept))
    assert len(after) == int(np.ceil(len(before) / 4)) and after < before
    for (ids, pixels), (kept_ids, kept_pixels) in zip(frames, kept):
        mask = np.isin(ids, list(after))
        assert np.array_equal(ids[mask], kept_ids) and np.array_equal(pixels[:, mask], kept_pixels)


def test_tracks_lose_their_ends():
    frames = [(np.array([7, 8] if k < 4 else [7]), np.zeros((4, 2 if k < 4 else 1))) for k in range(10)]

    def lengths(cut):
        ids = np.concatenate([i for i, _ in cut])
        return (ids == 7).sum(), (ids == 8).sum()
    assert lengths(degradation.cut_tracks(frames)) == (10, 4)
    assert lengths(degradation.cut_tracks(frames, longest=3)) == (3, 3)
    assert lengths(degradation.cut_tracks(frames, drop_last=0.5)) == (5, 2)
    assert lengths(degradation.cut_tracks(frames, drop_last=0.9)) == (1, 1)
    cut = degradation.cut_tracks(frames, longest=3)
    assert [len(ids) for ids, _ in cut] == [2, 2, 2] + [0] * 7  # the ends, not the beginnings


def test_blackout_is_as_long_as_told(dataset, frames):
    dark = degradation.black_out(frames, dataset.stamps, 1.0, 2.0)
    empty = [k for k, (ids, _) in enumerate(dark) if len(ids) == 0]
    assert empty == list(range(10, 30))
    assert np.array_equal(dark[30][1], frames[30][1])
    for start, duration in ((1.0, -3.0), (np.nan, 3.0), (1000.0, 5.0), (1.0, np.nan)):
        with pytest.raises(InputError, match="--blackout .*: no frame is within it, allowed: a START from 0 to 3.900 s"):
            degradation.black_out(frames, dataset.stamps, start, duration)


def test_good_twist_is_the_true_one_with_noise_of_the_given_size(dataset, truth):
    exact = degradation.good_twist(dataset, truth, 0.0, 0.0, seed=1)
    assert np.allclose(np.vstack([exact.linear_velocity, exact.angular_velocity]), TWIST[:, None], atol=1e-6)
    poses = dead_reckon(dataset.stamps, exact.linear_velocity, exact.angular_velocity)
    assert np.allclose(poses, truth[1], atol=1e-5)
    noisy, again = (degradation.good_twist(dataset, truth, 0.1, 0.01, seed=1) for _ in range(2))
    error = np.vstack([noisy.linear_velocity, noisy.angular_velocity]) - TWIST[:, None]
    assert error[:3].std() == pytest.approx(0.1, rel=0.25) and error[3:].std() == pytest.approx(0.01, rel=0.25)
    assert np.array_equal(noisy.angular_velocity, again.angular_velocity)


def test_truth_must_reach_every_frame(dataset, truth):
    with pytest.raises(InputError, match="one for each of the 40 frames"):
        degradation.good_twist(dataset, (truth[0][:-1], truth[1][:-1]), 0.1, 0.01, seed=1)


def added(before, after):
    """{id: [(frame, pixels)]} of what `after` has on top of `before`."""
    known, tracks = set(np.concatenate([ids for ids, _ in before])), {}
    for k, (ids, pixels) in enumerate(after):
        for number, column in zip(ids, pixels.T):
            if number not in known:
                tracks.setdefault(number, []).append((k, column))
    return tracks


def test_traffic_has_the_share_it_should(dataset, frames, truth):
    busy, count = add_traffic(dataset, frames, truth, 0.6, seed=3)
    tracks = added(frames, busy)
    assert sum(len(t) for t in tracks.values()) == count
    assert count / sum(len(ids) for ids, _ in busy) == pytest.approx(0.6, abs=0.02)
    assert all(len(set(ids)) == len(ids) for ids, _ in busy)


def test_traffic_moves_but_not_with_the_world(dataset, frames, truth):
    busy, _ = add_traffic(dataset, frames, truth, 0.6, seed=3)
    moved, still = [], []
    (fu, _, cu), (_, fv, cv) = dataset.intrinsics[:2]
    for track in added(frames, busy).values():
        if len(track) < 8:
            continue
        world, camera = [], []
        for k, (ul, vl, ur, vr) in (track[0], track[7]):
            z = fu * dataset.baseline / (ul - ur)
            p = np.array([(ul - cu) / fu * z, (0.5 * (vl + vr) - cv) / fv * z, z, 1.0])
            camera.append(p[:3])
            world.append((truth[1][k] @ inverse(dataset.cam_T_imu) @ p)[:3])
        assert abs(track[0][1][1] - track[0][1][3]) < 10.0 * PIXEL_NOISE
        moved.append(np.linalg.norm(world[1] - world[0]))
        still.append(np.linalg.norm(camera[1] - camera[0]))
    # We drive 5.6 m in 0.7 s; cars keep their distance to about 2 m.
    assert len(moved) > 5 and 3.0 < np.median(moved) < 9.0 and np.median(still) < 3.5


def test_command_line_writes_a_bag_with_truth(save, truth, tmp_path):
    source, kitti, bag = save(drive(frames=FRAMES, landmarks=40)), tmp_path / "truth.txt", tmp_path / "out.bag"
    np.savetxt(str(kitti), truth[1][:30, :3].reshape(-1, 12))
    result = script("degraded_bag.py", source, bag, "--truth", kitti, "--every", "2", "--good-twist")
    assert result.returncode == 0 and "wrote: " in result.stdout, result.stderr
    reference = read_reference(str(bag))
    assert len(reference.frame_stamps) == len(reference.truth[0]) == 30


@pytest.mark.parametrize("rate, options", [(2, ["--good-twist"]), (0.5, [])])
def test_a_truth_with_stamps_of_its_own_ends_where_it_ends(save, truth, tmp_path, rate, options):
    source, tum, bag = save(drive(frames=FRAMES, landmarks=40)), tmp_path / "truth.tum", tmp_path / "out.bag"
    stamps = truth[0][0] + np.arange(0.0, 2.95, 0.1 / rate)
    tum.write_text("".join(tum_line(t, se3_exp((t - stamps[0]) * TWIST)) + "\n" for t in stamps))
    result = script("degraded_bag.py", source, bag, "--truth", tum, *options)
    assert result.returncode == 0, result.stderr
    assert len(read_reference(str(bag)).frame_stamps) == int(10.0 * (stamps[-1] - stamps[0]) + 1.5)


@pytest.mark.parametrize("arguments, word", [
    (["--every", "0"], "--every is 0"), (["--traffic", "1"], "--traffic is 1"),
    (["--drop-last", "-0.1"], "--drop-last"),
    (["--longest", "0"], "--longest is 0"), (["--gyro-sigma", "0"], "--gyro-sigma"), (["--seed", "-1"], "--seed is -1"),
])
def test_command_line_refuses(save, tmp_path, arguments, word, capsys):
    source = save(drive())
    assert degrade([source, str(tmp_path / "out.bag"), "--truth", "none.txt", *arguments]) == 2
    assert word in capsys.readouterr().err and not (tmp_path / "out.bag").exists()
