from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from radar_images import read_image
from safetensors.numpy import load_file, save_file

from offradar_ros.config import EncoderConfig
from offradar_ros.encoders.protocol import Encoder
from offradar_ros.encoders.rad_vlad import RadVladEncoder
from offradar_ros.encoders.rad_vlad_codebook import Codebook, load_codebook, repetition
from offradar_ros.encoders.rad_vlad_fit import fit_rad_vlad
from offradar_ros.encoders.rad_vlad_rows import RowSettings, spectrum_rows
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.errors import ConfigError, DataError, ModelError, RefusedInput
from offradar_ros.types import PolarScan


def scan_of(power: np.ndarray, range_resolution_m: float = 0.25, range_offset_m: float = 0.0) -> PolarScan:
    azimuths = np.linspace(0.0, 2 * np.pi, len(power), endpoint=False)
    return PolarScan(1_000_000_007, power, azimuths, range_resolution_m, range_offset_m)


def scene(seed: int, azimuths: int = 400, bins: int = 256) -> PolarScan:
    """Random reflectors and a noise floor."""
    rng = np.random.default_rng(seed)
    power = rng.integers(0, 12, (azimuths, bins))
    for row, at, value in rng.integers((0, 12, 80), (azimuths, bins - 4, 220), (azimuths // 2, 3)):
        power[row : row + 4, at : at + 3] = value
    return scan_of(power.astype(np.uint8))


SCENES = [scene(seed) for seed in range(8)]


@pytest.fixture(scope='module')
def codebook() -> Codebook:
    return fit_rad_vlad(SCENES, seed=1, centres=16)


@pytest.fixture(scope='module')
def encoder(codebook: Codebook) -> RadVladEncoder:
    return RadVladEncoder(codebook)


def published(scan: PolarScan, codebook: Codebook) -> np.ndarray:
    """The published method, with the full spectrum, in loops."""
    bins, features = codebook.rows.bins, codebook.rows.features
    weights = np.array([1.0 if k in (0, bins // 2) else math.sqrt(2.0) for k in range(features)])

    def whole(half: np.ndarray) -> np.ndarray:
        return np.array([half[min(k, bins - k)] for k in range(bins)])

    centres = [whole(centre / weights) for centre in codebook.centres.astype(np.float64)]
    width_m = codebook.rows.max_range_m / bins
    sums = np.zeros((len(centres), bins))
    for row in scan.power.astype(np.float64):
        rings = np.zeros(bins)
        for ring in range(bins):
            for k in range(len(row)):
                near = max(ring * width_m, k * scan.range_resolution_m, codebook.rows.min_range_m)
                far = min((ring + 1) * width_m, (k + 1) * scan.range_resolution_m)
                rings[ring] += row[k] * max(0.0, far - near) / width_m
        spectrum = np.abs(np.fft.fft(rings / 255))
        spectrum /= np.sqrt(np.sum(spectrum**2))
        nearest = int(np.argmin([np.sum((spectrum - centre) ** 2) for centre in centres]))
        sums[nearest] += spectrum - centres[nearest]
    vlad = np.sign(sums).ravel() * np.sqrt(np.abs(sums).ravel())
    return np.asarray(vlad / np.sqrt(vlad @ vlad))


def test_distances_are_those_of_the_published_method() -> None:
    small = [scene(seed, azimuths=24, bins=40) for seed in range(4)]
    codebook = fit_rad_vlad(small, seed=0, centres=5, rows=RowSettings(max_range_m=9.0, min_range_m=1.1, bins=32))
    encoder = RadVladEncoder(codebook)
    ours = [encoder.encode(scan).mean.astype(np.float64) for scan in small]
    theirs = [published(scan, codebook) for scan in small]
    assert ours[0].shape == (5 * 17,)
    assert theirs[0].shape == (5 * 32,)
    for i in range(4):
        for j in range(i):
            expected = np.linalg.norm(theirs[i] - theirs[j])
            assert np.linalg.norm(ours[i] - ours[j]) == pytest.approx(expected, abs=1e-5)


@settings(max_examples=25, deadline=None)
@given(turn=st.integers(1, 399), index=st.integers(0, 7))
def test_a_turn_on_the_spot_changes_nothing(encoder: RadVladEncoder, turn: int, index: int) -> None:
    scan = SCENES[index]
    turned = encoder.encode(dataclasses.replace(scan, power=np.roll(scan.power, turn, axis=0)))
    still = encoder.encode(scan)
    np.testing.assert_array_equal(turned.mean, still.mean)
    np.testing.assert_array_equal(turned.variance, still.variance)


def test_shape_and_identity_of_an_embedding(encoder: RadVladEncoder) -> None:
    assert isinstance(encoder, Encoder)
    embedding = encoder.encode(SCENES[3])
    assert embedding.mean.shape == embedding.variance.shape == (encoder.info.dimension,) == (16 * 257,)
    assert embedding.mean.dtype == embedding.variance.dtype == np.float32
    assert np.linalg.norm(embedding.mean) == pytest.approx(1.0, abs=1e-5)
    assert embedding.model == encoder.info.fingerprint
    assert embedding.stamp_ns == SCENES[3].stamp_ns


def test_scale_of_power_and_number_of_azimuths_do_not_matter(encoder: RadVladEncoder) -> None:
    scan = SCENES[0]
    halved = dataclasses.replace(scan, power=(scan.power // 2) * 2)
    quartered = dataclasses.replace(scan, power=scan.power // 2)
    np.testing.assert_allclose(encoder.encode(halved).mean, encoder.encode(quartered).mean, atol=1e-6)
    twice = scan_of(np.repeat(scan.power, 2, axis=0))
    np.testing.assert_allclose(encoder.encode(twice).mean, encoder.encode(scan).mean, atol=1e-6)


def test_sensors_of_other_resolutions_give_similar_descriptors(encoder: RadVladEncoder) -> None:
    means = np.array([encoder.encode(scan).mean for scan in SCENES])
    for index, scan in enumerate(SCENES):
        finer = scan_of(np.repeat(scan.power, 5, axis=1), 0.05)
        distances = np.linalg.norm(means - encoder.encode(finer).mean, axis=1)
        assert int(np.argmin(distances)) == index
        assert distances[index] < 0.05


def test_rows_are_normalised_spectra() -> None:
    rows = spectrum_rows(SCENES[0], RowSettings(max_range_m=64.0, min_range_m=0.0, bins=256))
    for row, power in zip(rows[:5], SCENES[0].power[:5], strict=True):
        whole = np.abs(np.fft.fft(power.astype(np.float64)))
        expected = whole[:129] / np.sqrt(np.sum(whole**2))
        expected[1:-1] *= np.sqrt(2.0)
        np.testing.assert_allclose(row, expected, atol=1e-8)


def test_azimuths_without_power_are_not_part_of_the_descriptor(encoder: RadVladEncoder) -> None:
    power = SCENES[0].power.copy()
    power[100:150] = 0
    without = scan_of(np.delete(power, np.s_[100:150], axis=0))
    np.testing.assert_array_equal(encoder.encode(scan_of(power)).mean, encoder.encode(without).mean)
    assert encoder.encode(scan_of(power)).uncertainty > encoder.encode(without).uncertainty


@pytest.mark.parametrize('shape', [(0, 0), (0, 256), (400, 0), (400, 256)])
def test_scans_without_signal_are_refused(encoder: RadVladEncoder, shape: tuple[int, int]) -> None:
    with pytest.raises(RefusedInput, match='scan at 1000000007 ns') as refused:
        encoder.encode(scan_of(np.zeros(shape, np.uint8)))
    assert refused.value.cause == 'no_signal'


def test_uncertainty_is_1_on_average_over_the_fit_and_increases_with_every_fault(encoder: RadVladEncoder) -> None:
    clean = np.array([encoder.encode(scan).uncertainty for scan in SCENES])
    assert clean.mean() == pytest.approx(1.0, abs=0.2)
    rng = np.random.default_rng(0)
    for fault in ('noise', 'saturated', 'blocked', 'silent'):
        for scan, before in zip(SCENES, clean, strict=True):
            power = scan.power.copy()
            if fault == 'noise':
                power = np.maximum(power, rng.integers(150, 200, power.shape)).astype(np.uint8)
            elif fault == 'saturated':
                power[::2] = 250
            elif fault == 'blocked':
                power[:200, :20], power[:200, 20:] = 200, 0
            else:
                power[:200] = 0
            assert encoder.encode(dataclasses.replace(scan, power=power)).uncertainty > 1.2 * before, fault


def test_repetition_is_the_share_of_pairs_of_one_group() -> None:
    groups = [0, 0, 0, 1, 1, 4]
    pairs = [(a, b) for a in range(6) for b in range(6) if a != b]
    expected = np.mean([groups[a] == groups[b] for a, b in pairs])
    assert repetition(np.bincount(groups)) == pytest.approx(float(expected))
    silent = [*groups, -1, -1]
    pairs = [(a, b) for a in range(8) for b in range(8) if a != b]
    expected = np.mean([silent[a] == silent[b] or -1 in (silent[a], silent[b]) for a, b in pairs])
    assert repetition(np.bincount(groups), 2) == pytest.approx(float(expected))
    assert repetition(np.array([7])) == 1.0
    assert repetition(np.array([1])) == repetition(np.array([], np.int64)) == 0.0


def test_centres_and_fingerprint_depend_on_the_seed() -> None:
    one, two, other = (fit_rad_vlad(SCENES, seed, centres=8, rows_per_scan=50) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.centres, two.centres)
    assert one.fingerprint == two.fingerprint != other.fingerprint


def test_a_fit_covers_the_range_of_the_first_scan_and_skips_scans_without_power() -> None:
    silent = scan_of(np.zeros((400, 256), np.uint8))
    codebook = fit_rad_vlad(iter([SCENES[0], silent]), 0, centres=8)
    assert codebook.rows == RowSettings(max_range_m=64.0)
    assert codebook.centres.shape == (8, 257)


@pytest.mark.parametrize('scans', [[], [scene(0, azimuths=6)], [scan_of(np.zeros((400, 256), np.uint8))]])
def test_too_few_rows_to_fit_are_refused(scans: list[PolarScan]) -> None:
    with pytest.raises(DataError, match='rad_vlad: expected scans of 64 azimuths or more'):
        fit_rad_vlad(scans, 0)


@pytest.mark.parametrize('wrong', [{'bins': 511}, {'bins': 0}, {'min_range_m': 64.0}, {'max_range_m': math.nan}])
def test_invalid_settings_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match='rad_vlad: '):
        RowSettings(**{'max_range_m': 64.0, **wrong})


def test_file_round_trip_and_registry(tmp_path: Path, codebook: Codebook, encoder: RadVladEncoder) -> None:
    path = tmp_path / 'centres.safetensors'
    dataclasses.replace(codebook, description='of eight scenes').save(path)
    found = load_codebook(path)
    np.testing.assert_array_equal(found.centres, codebook.centres)
    assert (found.rows, found.typical_repetition) == (codebook.rows, codebook.typical_repetition)
    assert found.description == 'of eight scenes'
    made = make_encoder(EncoderConfig(name='rad_vlad', weights=str(path)))
    assert made.info == encoder.info
    np.testing.assert_array_equal(made.encode(SCENES[0]).mean, encoder.encode(SCENES[0]).mean)


def test_invalid_files_are_refused_in_one_line(tmp_path: Path, codebook: Codebook) -> None:
    good = tmp_path / 'good.safetensors'
    codebook.save(good)
    content, tensors = good.read_bytes(), load_file(good)
    length = int.from_bytes(content[:8], 'little')
    metadata = json.loads(content[8 : 8 + length])['__metadata__']
    del metadata['offradar.digest']
    cases: dict[str, tuple[dict[str, np.ndarray], dict[str, str]]] = {
        'not the centres of rad_vlad': (tensors, {}),
        'holds no settings of rad_vlad': (tensors, {**metadata, 'offradar.rad_vlad': '[1]'}),
        'damaged or altered': ({'centres': tensors['centres'] + 1}, metadata),
        r'not a readable safetensors file \(.*centres': ({'other': tensors['centres']}, metadata),
    }
    for expected, (changed, text) in cases.items():
        save_file(changed, tmp_path / 'bad.safetensors', text)
        with pytest.raises(ModelError, match=rf'bad\.safetensors: .*{expected}') as refused:
            load_codebook(tmp_path / 'bad.safetensors')
        assert '\n' not in str(refused.value)
    dataclasses.replace(codebook, centres=codebook.centres[:, :100]).save(tmp_path / 'bad.safetensors')
    with pytest.raises(ModelError, match='expected float32 centres of 257 values'):
        load_codebook(tmp_path / 'bad.safetensors')
    with pytest.raises(ModelError, match=r'none\.safetensors: no such weights file'):
        load_codebook(tmp_path / 'none.safetensors')


@pytest.mark.parametrize(
    ('changes', 'expected'),
    [
        ({'typical_repetition': 0.0}, 'typical_repetition: expected a number of 0.001 or more, got 0'),
        ({'typical_repetition': '0.3'}, 'typical_repetition: expected a number'),
        ({'centres': np.nan}, 'its centres are not finite'),
    ],
)
def test_a_codebook_that_cannot_be_is_refused(
    tmp_path: Path, codebook: Codebook, changes: dict[str, Any], expected: str
) -> None:
    """Its fingerprint and digest are right."""
    if 'centres' in changes:
        changes = {'centres': np.full_like(codebook.centres, changes['centres'])}
    dataclasses.replace(codebook, **changes).save(tmp_path / 'odd.safetensors')
    with pytest.raises(ModelError, match=rf'odd\.safetensors: .*{expected}') as refused:
        load_codebook(tmp_path / 'odd.safetensors')
    assert '\n' not in str(refused.value)


def test_turned_recorded_scans_have_the_same_descriptor(real_data: Path) -> None:
    def read(folder: str, resolution_m: float) -> list[PolarScan]:
        paths = sorted(real_data.glob(f'{folder}/*.png'))
        return [scan_of(read_image(path)[:, 11:], resolution_m) for path in paths]

    oxford = read('oxford_tiny/radar', 0.0432)
    mulran = read('mulran_kaist03/sensor_data/radar/polar_oxford_form', 0.0595238)
    encoder = RadVladEncoder(fit_rad_vlad([*oxford[:6], *mulran], 0))
    for scan in oxford[:2]:
        turned = dataclasses.replace(scan, power=np.roll(scan.power, 123, axis=0))
        np.testing.assert_array_equal(encoder.encode(turned).mean, encoder.encode(scan).mean)
    means = np.array([encoder.encode(scan).mean for scan in oxford])
    assert np.linalg.norm(means[0] - means[1]) < np.linalg.norm(means[0] - encoder.encode(oxford[-1]).mean)
