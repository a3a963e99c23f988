"""Stale frames on tracks made by hand, and their known number on real drives."""

import numpy as np
import pytest
from conftest import data_file

from vi_ekf_slam.dataset.loader import load_dataset
from vi_ekf_slam.dataset.stale import assign_ids


def moving_tracks(landmarks, frames):
    """Pixels (4, M, T) that change in every frame, all seen."""
    return np.random.default_rng(5).uniform(10.0, 300.0, (4, landmarks, frames))


def repeat(features, frame, tracks=slice(None)):
    features[:, tracks, frame] = features[:, tracks, frame - 1]


def ids_of(features, **options):
    return assign_ids(features, (features != -1).all(axis=0), **options)


def test_moving_tracks_keep_their_index():
    result = ids_of(moving_tracks(6, 5))
    assert np.array_equal(result.ids, np.tile(np.arange(6)[:, None], 5))
    assert result.stale_frames == [] and result.restarted_tracks == 0


def test_a_repeated_frame_starts_new_tracks_there():
    features = moving_tracks(6, 5)
    repeat(features, 2)
    result = ids_of(features)
    assert result.stale_frames == [2] and result.restarted_tracks == 6
    for m in range(6):
        assert list(result.ids[m]) == [m, m, 6 + m, 6 + m, 6 + m]


def test_new_and_moving_tracks_on_a_stale_frame_keep_their_ids():
    features = moving_tracks(8, 4)
    features[:, 6, :2] = -1.0  # appears on the stale frame
    repeat(features, 2, slice(0, 6))  # track 7 moves on
    result = ids_of(features)
    assert result.stale_frames == [2] and result.restarted_tracks == 6
    assert list(result.ids[6]) == [-1, -1, 6, 6] and list(result.ids[7]) == [7, 7, 7, 7]


def test_consecutive_stale_frames():
    features = moving_tracks(5, 5)
    repeat(features, 2)
    repeat(features, 3)
    result = ids_of(features)
    assert result.stale_frames == [2, 3] and result.restarted_tracks == 10
    assert list(result.ids[1]) == [1, 1, 6, 11, 11]


def test_an_index_that_comes_back_is_itself_again():
    features = moving_tracks(6, 7)
    repeat(features, 2)
    features[:, 1, 4] = -1.0
    features[:, 2, 0:2] = -1.0  # gone before the stale frame
    features[:, 2, 2] = 50.0
    result = ids_of(features)
    assert list(result.ids[1]) == [1, 1, 7, 7, -1, 1, 1]
    assert list(result.ids[2]) == [-1, -1, 2, 2, 2, 2, 2]


def test_three_equal_numbers_of_four_are_not_a_repetition():
    features = moving_tracks(6, 4)
    features[:3, :, 2] = features[:3, :, 1]
    assert ids_of(features).stale_frames == []


def test_one_last_bit_is_motion():
    features = moving_tracks(6, 4)
    repeat(features, 2)
    features[1, :, 2] = np.nextafter(features[1, :, 2], np.inf)
    assert ids_of(features).stale_frames == []


@pytest.mark.parametrize("repeated, stale", [(6, True), (5, False)])
def test_half_of_the_survivors_must_repeat(repeated, stale):
    features = moving_tracks(12, 3)
    repeat(features, 1, slice(0, repeated))
    assert bool(ids_of(features).stale_frames) == stale


@pytest.mark.parametrize("tracks, stale", [(5, True), (4, False)])
def test_a_handful_of_tracks_is_too_few_to_tell(tracks, stale):
    features = moving_tracks(tracks, 3)
    repeat(features, 1)
    assert bool(ids_of(features).stale_frames) == stale


def test_unseen_tracks_do_not_count_as_repeated():
    features = moving_tracks(12, 3)
    features[:, :9, 1:] = -1.0
    assert ids_of(features).stale_frames == []


def test_kept_stale_frames_are_counted_all_the_same():
    features = moving_tracks(6, 4)
    repeat(features, 2)
    result = ids_of(features, repair=False)
    assert result.stale_frames == [2] and result.restarted_tracks == 0
    assert np.array_equal(result.ids, np.tile(np.arange(6)[:, None], 4))


@pytest.mark.parametrize("name, count", [("0022", 66), ("0027", 91), ("0034", 135), ("extra_0036", 0), ("extra_0095", 0)])
def test_known_number_on_real_drives(name, count):
    dataset = load_dataset(data_file(name + ".npz"))
    result = assign_ids(dataset.features, dataset.seen)
    assert len(result.stale_frames) == count
    assert dataset.partial == 0
    # No id is used twice, and none repeats its pixels between successive frames any more.
    same_id = (result.ids[:, 1:] == result.ids[:, :-1]) & (result.ids[:, 1:] >= 0)
    same_pixels = (dataset.features[:, :, 1:] == dataset.features[:, :, :-1]).all(axis=0)
    assert not (same_id & same_pixels).any()
    for k in range(dataset.frames):
        seen = result.ids[dataset.seen[:, k], k]
        assert len(np.unique(seen)) == len(seen)
