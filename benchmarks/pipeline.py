"""Latency from a published scan to its match or rejection, through the nodes over DDS: see README.md."""

from __future__ import annotations

import argparse
import dataclasses
import os
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from drives import SEED, decoded_scans, simulated_drive, write_map
from live_scans import DriveTiming, LiveScans, Recording, read_recording
from measuring import Timing, cache_folder, previous_results, rounded, single_threaded, write_results
from sample_networks import exported, quantised, random_weights

from offradar_ros.config import EncoderConfig
from offradar_ros.encoders.image_encoder import ImageEncoder
from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.encoders.protocol import Encoder
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.lab.live.node_processes import Stack, isolated_environment
from offradar_ros.types import PolarScan

RESULTS = Path(__file__).parent / 'results' / 'pipeline.json'
RATE_HZ = 4.0
PLACES = 10_000
DOMAIN_ID = 91
WARM_UP = 12
PACED_WARM_UP = 2
ALONE_S = 15.0
OVERLOAD, OVERLOADED = 'overload', 'vgg16'
OVERLOAD_HZ = 8.0
OVERLOAD_S = 60.0
REPORTED_S = 1.5
"""After this time the nodes' diagnostics, which come once a second, count every scan."""
ANY_U = {'query.delta': 1e6}
"""No scan is rejected as uncertain: random weights give an arbitrary U."""


def mapped(path: Path) -> dict[str, object]:
    """Parameters of nodes that map into, and search, this map, and align scans with its places."""
    return {'map.path': path, 'query.map_path': path, 'map.autosave_s': 0.0}


@dataclasses.dataclass(frozen=True)
class Candidate:
    """An encoder to measure: its name in the results, and its parameters."""

    name: str
    encoder: str
    weights: str = ''
    drawn_at_random: bool = False

    def config(self, threads: int) -> EncoderConfig:
        """Its configuration in this process."""
        return EncoderConfig(name=self.encoder, weights=self.weights, threads=threads)

    def parameters(self, threads: int) -> dict[str, object]:
        """Its parameters for the encoder node."""
        values: dict[str, object] = {'encoder.name': self.encoder, 'encoder.threads': threads}
        return values | ({'encoder.weights': self.weights} if self.weights else {})


NAMES = ('vgg16', 'vgg16_int8', 'compact', 'ring_key')


def candidate(name: str, folder: Path, drive: Path, vgg16: str = '') -> Candidate:
    """The paper's network in single precision or 8-bit integers, the compact one, or the ring key; makes its files."""
    if name == 'ring_key':
        return Candidate(name, 'ring_key')
    if name == 'compact':
        return Candidate(name, 'variational', 'compact')
    weights = Path(vgg16) if vgg16 else random_weights(folder, 'vgg16', NetworkConfig(backbone='vgg16'))
    path = exported(weights, folder) if name == 'vgg16' else quantised(weights, folder, drive)
    return Candidate(name, 'variational', str(path), not vgg16)


def paced(function: Callable[[PolarScan], object], scans: Sequence[PolarScan], seconds: float) -> list[float]:
    """Seconds of each call, one every quarter of a second, so that caches and clocks are as cold as with live scans."""
    taken, started_s = [], time.perf_counter()
    for k in range(PACED_WARM_UP + round(seconds * RATE_HZ)):
        time.sleep(max(0.0, started_s + k / RATE_HZ - time.perf_counter()))
        begun_s = time.perf_counter()
        function(scans[k % len(scans)])
        taken.append(time.perf_counter() - begun_s)
    return taken[PACED_WARM_UP:]


class EncoderAlone:
    """Times the encoder alone in this process, before and after the nodes run."""

    def __init__(self, config: EncoderConfig, scans: Sequence[PolarScan]) -> None:
        self._encoder: Encoder = make_encoder(config)
        self.info = self._encoder.info
        self._scans = scans
        self.network_s: list[float] = []
        self.image_s: list[float] = []

    def measure(self, seconds: float) -> None:
        """Time the network, and separately the making of its image."""
        encoder = self._encoder
        if isinstance(encoder, ImageEncoder):
            images = {id(scan): encoder.image(scan)[np.newaxis] for scan in self._scans}
            self.network_s += paced(lambda scan: encoder.infer(images[id(scan)]), self._scans, seconds)
            self.image_s += paced(encoder.image, self._scans, min(seconds, 5.0))
        else:
            self.network_s += paced(encoder.encode, self._scans, seconds)


@dataclasses.dataclass(frozen=True)
class Setting:
    """The data, duration and ROS domain of a run."""

    folder: Path
    drive: Path
    recording: Recording
    scans: Sequence[PolarScan]
    seconds: float
    domain_id: int


def at_four_hertz(encoder: Candidate, setting: Setting) -> dict[str, Any]:
    """Latency of the pipeline at 4 Hz, and the part of the network in it."""
    alone = EncoderAlone(encoder.config(threads=0), setting.scans)
    alone.measure(min(ALONE_S, setting.seconds))
    map_path = write_map(setting.folder / 'search.db', alone.info, setting.drive, PLACES)
    parameters = {**encoder.parameters(threads=0), **ANY_U, **mapped(map_path)}
    started_s = time.monotonic()
    nodes = Stack(setting.folder / 'logs' / encoder.name, setting.domain_id, parameters)
    with nodes, LiveScans(setting.recording) as live:
        live.warm_up(WARM_UP)
        first_s = live.first_embedding_s - started_s
        before = nodes.usage()
        driven = live.drive(setting.seconds, RATE_HZ)
        after = nodes.usage()
        diagnostics = dict(live.diagnostics)
    alone.measure(min(ALONE_S, setting.seconds))
    whole, network = Timing.of(list(driven.latencies_s)), Timing.of(alone.network_s)
    return {
        **_figures(driven, whole),
        'seconds': setting.seconds,
        'network_ms': rounded(network.median_ms),
        'ratio_to_network': rounded(whole.median_ms / network.median_ms),
        'rest_ms': rounded(whole.median_ms - network.median_ms),
        'image_ms': rounded(Timing.of(alone.image_s).median_ms) if alone.image_s else 0.0,
        'encoder_node_ms': float(diagnostics.get('encoder', {}).get('latency_p50_ms', 'nan')),
        'alignment': diagnostics.get('query', {}).get('alignment', ''),
        'query_node_ms': float(diagnostics.get('query', {}).get('latency_p50_ms', 'nan')),
        'start_to_first_embedding_s': rounded(first_s),
        'nodes': {
            name: {
                'rss_mb': rounded(after[name].resident_bytes / 1e6),
                'peak_mb': rounded(after[name].peak_bytes / 1e6),
                'cpu_share': rounded((after[name].cpu_s - before[name].cpu_s) / setting.seconds),
            }
            for name in after
        },
        'weights': 'drawn at random' if encoder.drawn_at_random else encoder.weights,
    }


def overloaded(encoder: Candidate, setting: Setting) -> dict[str, Any]:
    """Scans at twice the rate, on one core that is too slow for it: number and latency of the answers."""
    core = min(os.sched_getaffinity(0))
    others = os.sched_getaffinity(0) - {core} or {core}
    own = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {core})
    alone = EncoderAlone(encoder.config(threads=1), setting.scans)
    alone.measure(min(ALONE_S, setting.seconds))
    os.sched_setaffinity(0, others)
    map_path = write_map(setting.folder / 'search.db', alone.info, setting.drive, PLACES)
    parameters = {**encoder.parameters(threads=1), **ANY_U, **mapped(map_path)}
    seconds = min(OVERLOAD_S, setting.seconds)
    try:
        nodes = Stack(setting.folder / 'logs' / 'overload', setting.domain_id, parameters, cpus={core})
        with nodes, LiveScans(setting.recording) as live:
            live.warm_up(3)
            live.drive(seconds / 4, OVERLOAD_HZ)
            before, overtaken_before = nodes.usage(), overtaken(live)
            driven = live.drive(seconds, OVERLOAD_HZ)
            after, overtaken_after = nodes.usage(), overtaken(live)
    finally:
        os.sched_setaffinity(0, own)
    whole, network = Timing.of(list(driven.latencies_s)), Timing.of(alone.network_s)
    return {
        'encoder': encoder.name,
        'rate_hz': OVERLOAD_HZ,
        **_figures(driven, whole),
        'max_ms': rounded(max(driven.latencies_s) * 1e3),
        'network_ms': rounded(network.median_ms),
        'ratio_p99_to_network': rounded(whole.p99_ms / network.median_ms),
        'counted_overtaken': overtaken_after - overtaken_before,
        'rss_growth_mb': rounded(sum(after[name].resident_bytes - before[name].resident_bytes for name in after) / 1e6),
    }


def overtaken(live: LiveScans) -> int:
    """Number of scans that the encoder reports as dropped for newer ones."""
    time.sleep(REPORTED_S)
    return int(live.diagnostics.get('encoder', {}).get('dropped.overtaken', 0))


def _figures(driven: DriveTiming, whole: Timing) -> dict[str, Any]:
    figures = {key: value for key, value in whole.as_dict().items() if key != 'repeats'}
    return {**figures, 'scans': driven.sent, 'dropped': driven.sent - len(driven.latencies_s)}


HEADING = (
    f'{"encoder":12} {"median":>8} {"p99":>8} {"network":>8} {"ratio":>6} {"rest":>7} {"scans":>6} {"dropped":>7} '
    f'{"start":>7}  RSS of the nodes'
)


def line(name: str, row: Mapping[str, Any]) -> str:
    """A line of the printed table."""
    memory = ', '.join(f'{node.removesuffix("_node")} {use["rss_mb"]:.0f}' for node, use in row['nodes'].items())
    return (
        f'{name:12} {row["median_ms"]:5.1f} ms {row["p99_ms"]:5.1f} ms {row["network_ms"]:5.1f} ms '
        f'{row["ratio_to_network"]:6.2f} {row["rest_ms"]:4.1f} ms {row["scans"]:6} {row["dropped"]:7} '
        f'{row["start_to_first_embedding_s"]:5.2f} s  {memory} MB'
    )


def overload_line(row: Mapping[str, Any]) -> str:
    """The printed line of the overload."""
    return (
        f'overload: {row["encoder"]} at {row["rate_hz"]:g} Hz on one core: {row["scans"]} scans, {row["dropped"]} '
        f'overtaken ({row["counted_overtaken"]} counted by the node), latency median {row["median_ms"]:.0f} ms, p99 '
        f'{row["p99_ms"]:.0f} ms, {row["ratio_p99_to_network"]:.2f} inferences, memory {row["rss_growth_mb"]:+.1f} MB'
    )


def main() -> None:
    """Measure every encoder, then the overload; print and write both."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seconds', type=float, default=60.0, help='of driving with each encoder (default 60)')
    parser.add_argument('--folder', type=Path, default=Path('build/bench'), help='where drives and networks are kept')
    parser.add_argument('--vgg16', default='', metavar='FILE', help='trained weights (.safetensors); default: random')
    parser.add_argument(
        '--only',
        nargs='+',
        default=[],
        metavar='NAME',
        choices=(*NAMES, OVERLOAD),
        help='measure only these; the others keep their figures',
    )
    parser.add_argument('--domain', type=int, default=DOMAIN_ID, help=f'ROS domain (default {DOMAIN_ID})')
    parser.add_argument('--out', type=Path, default=RESULTS, help='default: the results in the repository')
    arguments = parser.parse_args()
    os.environ.update(isolated_environment(arguments.domain))
    folder = cache_folder(arguments.folder)
    drive = simulated_drive(folder)
    setting = Setting(
        folder, drive, read_recording(drive), decoded_scans(drive, 20), arguments.seconds, arguments.domain
    )
    kept = previous_results(arguments.out) if arguments.only else {}
    results: dict[str, dict[str, Any]] = kept.get('encoders', {})
    print(HEADING, flush=True)
    for name in (name for name in arguments.only or NAMES if name in NAMES):
        results[name] = at_four_hertz(candidate(name, folder, drive, arguments.vgg16), setting)
        print(line(name, results[name]), flush=True)
    overload = kept.get('overload')
    if not arguments.only or OVERLOAD in arguments.only:
        overload = overloaded(candidate(OVERLOADED, folder, drive, arguments.vgg16), setting)
        print(overload_line(overload))
    write_results(
        arguments.out,
        {'rate_hz': RATE_HZ, 'places': PLACES, 'encoders': results, 'overload': overload},
        {'drive': SEED, 'map': SEED, 'weights': SEED},
        kept,
    )


if __name__ == '__main__':
    single_threaded()
    main()
