"""Changes of the receiver: physics of the table against plain powers, and draws by seed and step."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip('torch')

from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.lab.drives.drive import Drive
from offradar_ros.lab.training.batches import BatchSampler
from offradar_ros.lab.training.config import BatchConfig
from offradar_ros.lab.training.images import image_batches
from offradar_ros.lab.training.receiver_changes import receiver_table, with_changes

BYTES = np.arange(256)
CHANGED = BatchConfig(places=4, gain_db=6.0, floor_db=12.0, knee_db=40.0)


def table_by_hand(gain_db: float, floor_db: float, knee_db: float) -> list[int]:
    table = []
    for byte in range(256):
        power = math.pow(10.0, byte / 20.0) - 1.0
        noise = math.pow(10.0, floor_db / 10.0) - 1.0
        level = 20.0 * math.log10(1.0 + power * math.pow(10.0, gain_db / 10.0) + noise)
        knee = 255.0 - 2.0 * knee_db
        if level > knee and knee_db > 0.0:
            level = knee + (255.0 - knee) * (1.0 - math.exp((knee - level) / (255.0 - knee)))
        table.append(round(min(255.0, level)))
    return table


@settings(max_examples=50, deadline=None)
@given(gain_db=st.floats(-20, 20), floor_db=st.floats(0, 40), knee_db=st.just(0.0) | st.floats(1e-9, 60))
def test_the_table_against_plain_powers(gain_db: float, floor_db: float, knee_db: float) -> None:
    table = receiver_table(gain_db, floor_db, knee_db)
    assert table.dtype == np.uint8 and table.shape == (256,)
    assert np.abs(table.astype(int) - table_by_hand(gain_db, floor_db, knee_db)).max() <= 1
    assert (np.diff(table.astype(int)) >= 0).all(), 'a stronger return never becomes the weaker one'


def test_without_changes_bytes_stay() -> None:
    assert np.array_equal(receiver_table(0.0, 0.0, 0.0), BYTES)


def test_a_floor_raises_small_bytes_and_leaves_large_ones() -> None:
    table = receiver_table(0.0, 20.0, 0.0).astype(int)
    assert table[0] == 40, 'where nothing was received is the floor: 20 dB, 40 half decibels'
    assert (table[:40] > BYTES[:40]).all()
    assert table[40] == pytest.approx(40 + 6, abs=1), 'twice the power is 3 dB more'
    assert np.array_equal(table[90:], BYTES[90:])


def test_a_gain_moves_what_is_above_the_floor_by_a_constant() -> None:
    up, down = receiver_table(5.0, 0.0, 0.0).astype(int), receiver_table(-5.0, 0.0, 0.0).astype(int)
    assert np.array_equal(up[60:240], BYTES[60:240] + 10)
    assert np.array_equal(down[60:], BYTES[60:] - 10)
    assert up[0] == down[0] == 0, 'no gain makes a return of nothing'
    assert up[-1] == 255


def test_a_knee_compresses_large_bytes_alone() -> None:
    table = receiver_table(0.0, 0.0, 50.0).astype(int)
    assert np.array_equal(table[:156], BYTES[:156])
    assert (table[170:] < BYTES[170:]).all()
    assert table[-1] < 255


def test_changes_depend_on_seed_and_step_alone_and_differ_between_views(make_drive: Callable[..., Drive]) -> None:
    drives = [make_drive('a'), make_drive('b', lane_m=5.0)]
    one, another = (BatchSampler(drives, CHANGED, 3) for _ in range(2))
    one.batch(0)
    changes = one.batch(7).changes
    assert np.array_equal(changes, another.batch(7).changes)
    assert not np.array_equal(changes, one.batch(8).changes)
    assert len(np.unique(changes, axis=0)) == 8
    low, high = (-6.0, 0.0, 0.0), (6.0, 12.0, 40.0)
    drawn = np.concatenate([one.batch(step).changes for step in range(200)])
    assert (drawn >= low).all() and (drawn <= high).all()
    assert drawn.mean(axis=0) == pytest.approx([0.0, 6.0, 20.0], abs=1.0)


def test_the_scans_and_turns_of_a_batch_do_not_depend_on_the_changes(make_drive: Callable[..., Drive]) -> None:
    drives = [make_drive('a'), make_drive('b', lane_m=5.0)]
    changed, plain = (BatchSampler(drives, config, 3).batch(5) for config in (CHANGED, BatchConfig(places=4)))
    assert np.array_equal(changed.scans, plain.scans) and np.array_equal(changed.spins, plain.spins)
    assert not plain.changes.any()


def test_images_are_of_changed_scans_and_blanked_cells_stay_blank(make_drive: Callable[..., Drive]) -> None:
    drives = [make_drive('a'), make_drive('b', lane_m=5.0)]
    network = NetworkConfig(backbone='compact', azimuths=48, range_bins=64, resolution_m=1.0, min_range_m=5.0)
    config = dataclasses.replace(CHANGED, spin=False, gain_db=0.0, floor_db=60.0, knee_db=0.0)
    plain = BatchSampler(drives, dataclasses.replace(config, floor_db=0.0), 3)
    ((_, before, _),) = image_batches(plain, network, range(1), 1)
    ((_, after, batch),) = image_batches(BatchSampler(drives, config, 3), network, range(1), 1)
    for view in range(8):
        floor = 2.0 * batch.changes[view, 1]
        measured = after[view][:, 5:].numpy()
        assert measured.min() == pytest.approx(floor, abs=8.0)
        assert (after[view] >= before[view]).all()
        assert not after[view][:, :4].any(), 'no noise where nothing is measured'


def test_a_scan_without_changes_is_not_copied(make_drive: Callable[..., Drive]) -> None:
    scan = make_drive('a').scan(0)
    assert with_changes(scan, np.zeros(3)) is scan
