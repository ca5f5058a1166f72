from __future__ import annotations

import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from radar_images import speckle
from rosbags.rosbag2 import Reader, StoragePlugin, Writer

from offradar_ros.recordings.bags.reader import TYPES, Bag
from offradar_ros.recordings.bags.sequence import BagSequence
from offradar_ros.recordings.bags.topics import SCANS
from offradar_ros.recordings.datasets.registry import LAYOUTS, open_sequence

WAIT_S = 60.0


def counts(path: Path) -> dict[str, int]:
    with Bag(path) as bag:
        return bag.counts


@pytest.mark.parametrize(('name', 'scans'), [('oxford_tiny', 11), ('radiate_tiny_foggy', 18)])
def test_every_scan_of_a_recording_is_in_the_bag(
    done: Callable[..., str], real_data: Path, tmp_path: Path, name: str, scans: int
) -> None:
    printed = done('convert', real_data / name, tmp_path / 'bag')
    assert f'/radar_data/b_scan_image: {scans} messages\n' in printed
    assert printed.endswith(f'{tmp_path / "bag"}: written\n')
    source, bag = open_sequence(real_data / name), BagSequence(tmp_path / 'bag')
    assert len(bag) == scans
    np.testing.assert_array_equal(bag.stamps_ns, source.stamps_ns)
    for index in range(scans):
        np.testing.assert_array_equal(bag.scan(index).power, source.scan(index).power)
    assert [path.name for path in tmp_path.iterdir()] == ['bag']


def test_plain_leaves_the_metadata_columns_out(done: Callable[..., str], real_data: Path, tmp_path: Path) -> None:
    done('convert', real_data / 'oxford_tiny', tmp_path / 'kept')
    done('convert', real_data / 'oxford_tiny', tmp_path / 'plain', '--plain')
    widths = []
    for name in ('kept', 'plain'):
        with Bag(tmp_path / name) as bag:
            widths.append(bag.decode(next(bag.messages(['/radar_data/b_scan_image']))).width)
    assert widths == [3779, 3768]


def test_an_offset_brings_positions_of_another_clock_back(
    done: Callable[..., str], real_data: Path, tmp_path: Path
) -> None:
    folder = real_data / 'radiate_tiny_foggy'
    printed = done('convert', folder, tmp_path / 'apart')
    (warning,) = [line for line in printed.splitlines() if 'no scan has a position' in line]
    assert warning == (
        'warning: positions: no scan has a position: positions start 59.8 s after the last scan '
        '(if the clocks disagree: offradar convert --position-offset-s -64.1)'
    )
    assert set(counts(tmp_path / 'apart')) == {'/radar_data/b_scan_image'}
    assert 'no scan' not in done('convert', folder, tmp_path / 'joined', '--position-offset-s', '-64.1')
    printed = done('convert', folder, tmp_path / 'nearer', '--position-offset-s', '-30')
    assert '--position-offset-s -64.1)' in printed
    assert counts(tmp_path / 'joined')['/gps/fix'] > 18


def test_the_offset_is_added_to_the_stamps(done: Callable[..., str], radiate_folder: Path, tmp_path: Path) -> None:
    done('convert', radiate_folder, tmp_path / 'bag', '--position-offset-s', '-60')
    bag, source = BagSequence(tmp_path / 'bag'), open_sequence(radiate_folder)
    assert bag.trajectory is not None
    assert source.trajectory is not None
    np.testing.assert_array_equal(bag.trajectory.stamps_ns, source.trajectory.stamps_ns - 60 * 10**9)
    np.testing.assert_array_equal(bag.trajectory.positions, source.trajectory.positions)


@pytest.mark.parametrize('seconds', ['nan', 'inf', '-1e300'])
def test_an_offset_that_is_too_large_is_refused(
    refused: Callable[..., str], radiate_folder: Path, tmp_path: Path, seconds: str
) -> None:
    printed = refused('convert', radiate_folder, tmp_path / 'bag', f'--position-offset-s={seconds}')
    assert '--position-offset-s: expected seconds within' in printed


def test_scans_without_a_position_are_counted(done: Callable[..., str], radiate_folder: Path, tmp_path: Path) -> None:
    printed = done('convert', radiate_folder, tmp_path / 'bag', '--position-offset-s', '-61.5')
    assert 'warning: positions: 3 of 5 scans have a position (gaps up to 1.5 s)\n' in printed


def test_one_message_is_one(done: Callable[..., str], street_bag: Callable[..., Path], tmp_path: Path) -> None:
    assert 'b_scan_image: 1 message\n' in done('convert', street_bag('one', count=1), tmp_path / 'bag')


def test_the_help_names_the_layouts(done: Callable[..., str]) -> None:
    assert all(name in done('convert', '--help') for name in LAYOUTS)


def test_a_source_without_positions_is_reported(done: Callable[..., str], radiate_folder: Path, tmp_path: Path) -> None:
    (radiate_folder / 'GPS_IMU_Twist.txt').unlink()
    assert 'no positions: the source has none; ' in done('convert', radiate_folder, tmp_path / 'bag')


def test_a_bag_is_converted_to_the_same_bag(
    done: Callable[..., str], street_bag: Callable[..., Path], tmp_path: Path
) -> None:
    first = street_bag('first', count=3)
    done('convert', first, tmp_path / 'second')
    both = []
    for path in (first, tmp_path / 'second'):
        with Bag(path) as bag:
            both.append([(m.topic, m.log_ns, m.cdr) for m in bag.messages(['/radar_data/b_scan_image', '/gps/fix'])])
    assert both[0] == both[1]


def test_an_existing_bag_is_kept_without_overwrite(
    done: Callable[..., str], refused: Callable[..., str], street_bag: Callable[..., Path], radiate_folder: Path
) -> None:
    bag = street_bag('bag', count=2)
    assert f'{bag}: exists already' in refused('convert', radiate_folder, bag)
    assert counts(bag)['/radar_data/b_scan_image'] == 2
    assert done('convert', radiate_folder, bag, '--overwrite').endswith(f'{bag}: replaced\n')
    assert counts(bag)['/radar_data/b_scan_image'] == 5


def test_overwrite_replaces_bags_only(refused: Callable[..., str], radiate_folder: Path, tmp_path: Path) -> None:
    (tmp_path / 'home').mkdir()
    (tmp_path / 'home' / 'thesis.tex').write_text('years of work')
    assert 'is not a bag' in refused('convert', radiate_folder, tmp_path / 'home', '--overwrite')
    assert (tmp_path / 'home' / 'thesis.tex').exists()


def test_a_damaged_source_leaves_no_bag(refused: Callable[..., str], radiate_folder: Path, tmp_path: Path) -> None:
    scan = radiate_folder / 'Navtech_Polar' / '000004.png'
    scan.write_bytes(scan.read_bytes()[:1000])
    printed = refused('convert', radiate_folder, tmp_path / 'bag')
    assert f'{scan}: truncated PNG' in printed
    assert printed.endswith('(--skip-unreadable leaves such scans out)')
    cv2.imwrite(str(scan), np.zeros((576, 400, 3), np.uint8))
    assert f'{scan}: ' in refused('convert', radiate_folder, tmp_path / 'bag')
    assert [path.name for path in tmp_path.iterdir()] == ['city_1']


def test_unreadable_scans_are_left_out_and_named_with_the_option(
    done: Callable[..., str], radiate_folder: Path, tmp_path: Path
) -> None:
    scans = sorted((radiate_folder / 'Navtech_Polar').glob('*.png'))
    scans[0].write_bytes(b'')
    scans[3].write_bytes(scans[3].read_bytes()[:1000])
    printed = done('convert', radiate_folder, tmp_path / 'bag', '--skip-unreadable', '--position-offset-s', '-60')
    summary = printed[printed.index('skipped') :].splitlines()
    assert summary == [
        'skipped 2 of 5 scans that cannot be read:',
        f'  {scans[0]}: empty file, expected a PNG',
        f'  {scans[3]}: truncated PNG, it ends after 1000 bytes',
        f'{tmp_path / "bag"}: written',
    ]
    source, bag = open_sequence(radiate_folder), BagSequence(tmp_path / 'bag')
    kept = [1, 2, 4]
    np.testing.assert_array_equal(bag.stamps_ns, source.stamps_ns[kept])
    for at, index in enumerate(kept):
        np.testing.assert_array_equal(bag.scan(at).power, source.scan(index).power)


@pytest.mark.parametrize('damage', [b'', b'\x89PNG\r\n\x1a\n'])
def test_an_unreadable_scan_with_metadata_columns_is_left_out(
    done: Callable[..., str], real_data: Path, tmp_path: Path, damage: bytes
) -> None:
    folder = tmp_path / 'oxford_tiny'
    shutil.copytree(real_data / 'oxford_tiny', folder)
    scans = sorted(folder.rglob('radar/*.png'))
    assert len(scans) == 11
    # The first, by which a layout is recognised, and the last.
    for scan in (scans[0], scans[-1]):
        scan.write_bytes(damage)
    printed = done('convert', folder, tmp_path / 'bag', '--skip-unreadable')
    assert 'skipped 2 of 11 scans that cannot be read:\n' in printed
    assert all(f'  {scan}: ' in printed for scan in (scans[0], scans[-1]))
    assert counts(tmp_path / 'bag')['/radar_data/b_scan_image'] == 9


def test_skipped_scans_are_reported_and_without_a_readable_scan_there_is_no_bag(
    done: Callable[..., str], refused: Callable[..., str], radiate_folder: Path, tmp_path: Path
) -> None:
    assert 'cannot be read' not in done('convert', radiate_folder, tmp_path / 'whole', '--skip-unreadable')
    scans = sorted((radiate_folder / 'Navtech_Polar').glob('*.png'))
    for scan in scans:
        scan.write_bytes(b'')
    printed = refused('convert', radiate_folder, tmp_path / 'bag', '--skip-unreadable')
    assert printed.endswith(f'none of its 5 scans can be read: {scans[0]}: empty file, expected a PNG')
    assert not (tmp_path / 'bag').exists()


def test_a_place_that_cannot_be_written_is_refused(
    refused: Callable[..., str], radiate_folder: Path, tmp_path: Path
) -> None:
    (tmp_path / 'file').write_text('in the way')
    assert 'cannot be written' in refused('convert', radiate_folder, tmp_path / 'file' / 'bag')


def test_a_missing_source_is_refused(refused: Callable[..., str], tmp_path: Path) -> None:
    assert 'no such folder' in refused('convert', tmp_path / 'nothing', tmp_path / 'bag')


MANY = 20_000


@pytest.fixture
def endless_folder(radiate_folder: Path) -> Path:
    """Five scans, and after them so many that the conversion is not at its end when it is interrupted."""
    listing = radiate_folder / 'Navtech_Polar.txt'
    frame, stamp_s = listing.read_text().split()[-3::2]
    assert frame == '000005'
    with listing.open('a') as file:
        for number in range(6, MANY):
            file.write(f'Frame: {number:06d} Time: {float(stamp_s) + number:.9f}\n')
            (radiate_folder / 'Navtech_Polar' / f'{number:06d}.png').symlink_to('000005.png')
    return radiate_folder


@pytest.mark.parametrize('sent', [signal.SIGINT, signal.SIGKILL])
def test_an_interrupted_run_leaves_nothing_that_looks_complete(
    done: Callable[..., str], refused: Callable[..., str], endless_folder: Path, tmp_path: Path, sent: signal.Signals
) -> None:
    out = tmp_path / 'bag'
    # A shell's background jobs, such as a run of these tests may be, and all that they start ignore Ctrl-C.
    hearing = ['env', '--default-signal=INT']
    command = [*hearing, sys.executable, '-m', 'offradar_ros.cli.main', 'convert', str(endless_folder), str(out)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    deadline_s = time.monotonic() + WAIT_S
    while not any(tmp_path.glob('bag.*.partial/**/*.mcap')):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline_s
        time.sleep(0.01)
    process.send_signal(sent)
    printed = ''.join(process.communicate(timeout=WAIT_S))
    assert process.returncode != 0
    assert 'Traceback' not in printed, printed
    left = [path.name for path in tmp_path.iterdir() if path != endless_folder]
    assert left == ([] if sent == signal.SIGINT else [path.name for path in tmp_path.glob('bag.*.partial')])
    for path in (*tmp_path.glob('bag*'), *tmp_path.glob('bag.*.partial/*')):
        assert re.search(r'no metadata\.yaml|no radar scans', refused('check', path))
    # The next run starts over.
    for number in range(6, MANY):
        (endless_folder / 'Navtech_Polar' / f'{number:06d}.png').unlink()
    done('convert', endless_folder, out)
    assert counts(out)['/radar_data/b_scan_image'] == 5
    assert not any(tmp_path.glob('bag.*.partial'))


def stored_scans(folder: Path, counts: NDArray[np.int64], stamps_ns: NDArray[np.int64] | None = None) -> Path:
    """Two scans in MulRan's form with metadata columns."""
    folder.mkdir(parents=True)
    for start_ns in (1_767_225_600_000_000_000, 1_767_225_600_250_000_000):
        image = np.random.default_rng(start_ns).integers(1, 200, (400, 11 + 3360), np.uint8)
        stamps = start_ns + 625_000 * np.arange(400) if stamps_ns is None else stamps_ns
        image[:, :8] = stamps.astype('<i8').reshape(-1, 1).view(np.uint8)
        image[:, 8:10] = counts.astype('<u2').reshape(-1, 1).view(np.uint8)
        cv2.imwrite(str(folder / f'{start_ns}.png'), image)
    return folder.parent


def test_the_parameters_that_a_refusal_names_are_taken(
    done: Callable[..., str], refused: Callable[..., str], tmp_path: Path
) -> None:
    source = stored_scans(tmp_path / 'drive' / 'polar_oxford_form', np.zeros(400, np.int64))
    assert 'radar.row_angles to equal' in refused('convert', source, tmp_path / 'bag')
    params = tmp_path / 'equal.yaml'
    radar = '{row_angles: equal, azimuth_offset_rad: 0.5, azimuth_direction: counterclockwise}'
    params.write_text(f'/**:\n  ros__parameters:\n    radar: {radar}\n')
    done('convert', source, tmp_path / 'bag', '--params', params)
    azimuths = BagSequence(tmp_path / 'bag').scan(0).azimuths_rad
    # Where the sensor is mounted is no part of a recording: it would be applied once more when the bag is read.
    assert azimuths == pytest.approx(np.radians(0.9 * np.arange(400)))
    done('convert', tmp_path / 'drive', tmp_path / 'again', '--params', params)


def test_mended_rows_are_reported(done: Callable[..., str], tmp_path: Path) -> None:
    counts = 7 + 14 * np.arange(400)
    counts[100] = 5600
    unset = stored_scans(tmp_path / 'drive' / 'polar_oxford_form', counts, 900 * 10**9 + 625_000 * np.arange(400))
    printed = done('convert', unset, tmp_path / 'bag')
    assert 'warning: encoder counts that contradict the others, their azimuths are interpolated: 2 scans ' in printed
    assert "warning: row stamps of a clock that was never set, or in no order: the scan's stamp is taken" in printed
    assert 'problem' not in done('check', tmp_path / 'bag')


def test_a_damaged_row_of_positions_costs_no_drive(
    done: Callable[..., str], radiate_folder: Path, tmp_path: Path
) -> None:
    listing = radiate_folder / 'GPS_IMU_Twist.txt'
    whole = listing.read_text()
    sound = done('convert', radiate_folder, tmp_path / 'sound', '--position-offset-s', '-60')
    listing.write_text(whole + 'Frame: 0001')
    printed = done('convert', radiate_folder, tmp_path / 'cut', '--position-offset-s', '-60')
    assert counts(tmp_path / 'cut') == counts(tmp_path / 'sound')
    assert 'left out' not in sound
    assert f'warning: positions: 1 position left out: damaged (line {len(whole.splitlines()) + 1}: ' in printed


def test_a_bag_of_clocks_that_disagree_is_corrected_by_the_option(
    done: Callable[..., str], street_bag: Callable[..., Path], tmp_path: Path
) -> None:
    with Bag(street_bag('true', count=160)) as bag:
        messages = [(raw.topic, raw.msgtype, raw.log_ns, bag.decode(raw)) for raw in bag.messages()]
    with Writer(tmp_path / 'apart', version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {
            topic: writer.add_connection(topic, kind, typestore=TYPES) for topic, kind in {m[:2] for m in messages}
        }
        for topic, kind, log_ns, message in messages:
            if topic == '/radar_data/b_scan_image':
                message.header.stamp.sec -= 37
            writer.write(connections[topic], log_ns, TYPES.serialize_cdr(message, kind))
    printed = done('convert', tmp_path / 'apart', tmp_path / 'uncorrected')
    option = printed.partition('offradar convert ')[2].splitlines()[0].split()
    assert option == ['--position-offset-s', '-37.0']
    assert 'disagree' not in done('convert', tmp_path / 'apart', tmp_path / 'corrected', *option)
    trajectory = BagSequence(tmp_path / 'corrected').trajectory
    true = BagSequence(tmp_path / 'true').trajectory
    assert trajectory is not None
    assert true is not None
    np.testing.assert_array_equal(trajectory.stamps_ns + 37 * 10**9, true.stamps_ns)


def test_odd_scans_are_told_of_as_check_does(done: Callable[..., str], tmp_path: Path) -> None:
    """Names of two files exchanged, one scan there twice, one of another size."""
    folder, start_us = tmp_path / 'drive' / 'radar', 1_700_000_000_000_000
    folder.mkdir(parents=True)
    for k in range(6):
        stamp_us = start_us + k * 250_000
        power = speckle(1, (400, 400 if k == 5 else 576), seed=0 if k == 1 else k)[0]
        stamps = (stamp_us + np.arange(400) * 625).astype('<i8').reshape(-1, 1).view(np.uint8)
        counts = (np.arange(400) * 14).astype('<u2').reshape(-1, 1).view(np.uint8)
        image = np.concatenate([stamps, counts, np.full((400, 1), 255, np.uint8), power], axis=1)
        name = start_us + {2: 4, 4: 2}.get(k, k) * 250_000
        cv2.imwrite(str(folder / f'{name}.png'), image)
    params = tmp_path / 'car.yaml'
    params.write_text('radar: {range_resolution_m: 0.175}')
    printed = done('convert', folder.parent, tmp_path / 'bag', '--params', params)
    assert 'warning: 1 scan with the very power of the one before, which no radar measures' in printed
    assert 'warning: stamp of the scan is not within the stamps of its rows: 2 scans' in printed
    assert 'warning: odd size: 1 scan of 400 azimuths × 400 range bins' in printed


def test_a_scan_of_a_bag_that_cannot_be_read_is_named(
    refused: Callable[..., str], street_bag: Callable[..., Path], tmp_path: Path
) -> None:
    bag = street_bag('town', count=3)
    with Reader(bag) as reader:
        recorded = [(c.topic, c.msgtype, log_ns, cdr) for c, log_ns, cdr in reader.messages()]
    with Writer(tmp_path / 'odd', version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {t: writer.add_connection(t, kind, typestore=TYPES) for t, kind in {r[:2] for r in recorded}}
        for topic, _, log_ns, cdr in recorded:
            # The nanoseconds of the stamp.
            broken = cdr[:8] + b'\xff\xff\xff\x7f' + cdr[12:] if topic == SCANS else cdr
            writer.write(connections[topic], log_ns, broken)
    assert 'error: odd, scan 0: header stamp of ' in refused('convert', tmp_path / 'odd', tmp_path / 'out')
