"""Views per second of training on this machine, by backbone, size of image, layout in memory and frozen layers.

Steps are those of `offradar train`, with the settings of its presets, in single precision and on the CPU; scans are
noise, on which no time depends. The images are made meanwhile, as in a training. CPU time is that of all threads: it
suffers less than views per second from other work on the machine.
"""

from __future__ import annotations

import argparse
import dataclasses
import tempfile
import time
from pathlib import Path

import numpy as np
import torch
from measuring import interleaved, machine

from offradar_ros.encoders.networks.registry import make_network
from offradar_ros.lab.drives.drive import Drive
from offradar_ros.lab.training.batches import BatchSampler
from offradar_ros.lab.training.config import BatchConfig, TrainingConfig
from offradar_ros.lab.training.config_file import read_config
from offradar_ros.lab.training.loop import Loop
from offradar_ros.lab.training.objectives import make_objective
from offradar_ros.lab.training.parallel import Group
from offradar_ros.types import PolarScan

PRESETS = Path(__file__).resolve().parents[1] / 'params' / 'train'
AZIMUTHS, RANGE_BINS, RANGE_RESOLUTION_M = 400, 346, 0.4752
"""Of a cached scan of VGG-16 at 1 m a pixel."""
FIELD_OF_VIEW_M = 256.0
FROZEN = (0, 1, 2, 3)
COMPACT, VGG16 = 'compact', 'vgg16'


def main() -> None:
    """Print a Markdown table of views per second."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--sides', type=int, nargs='*', default=[128, 256], help='pixels of VGG-16')
    parser.add_argument(
        '--views', type=int, default=8, help='views in a step of VGG-16; compact has eight times as many'
    )
    parser.add_argument(
        '--steps', type=int, default=5, help='steps of which the median is taken, after one that is not'
    )
    parser.add_argument('--threads', type=int, default=torch.get_num_threads(), help='threads of torch')
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    found = machine()
    print(f'{found["processor"]}, {found["cores"]} cores, {arguments.threads} threads, torch {torch.__version__}\n')
    heads = ('network', 'memory', 'at once', 'frozen groups', 'views/s', 'quartiles', 'CPU time of a view')
    print('| ' + ' | '.join(heads) + ' |\n' + '|---' * len(heads) + '|')
    for config in _variants(arguments.views, arguments.sides):
        print(_row(config, arguments.steps), flush=True)
    print('\nA step of AdamW over the weights of VGG-16, ' + ', '.join(map(_optimiser_time, arguments.sides)))


def _variants(views: int, sides: list[int]) -> list[TrainingConfig]:
    compact, vgg16 = (read_config(PRESETS / f'{name}.yaml') for name in (COMPACT, VGG16))
    variants = [_variant(compact, 8 * views, channels_last) for channels_last in (True, False)]
    variants.append(_variant(compact, 8 * views, True, chunk=2 * views))
    for side in sides:
        network = dataclasses.replace(vgg16.network, side_px=side, resolution_m=FIELD_OF_VIEW_M / side)
        sized = dataclasses.replace(vgg16, network=network)
        variants += [_variant(sized, views, channels_last) for channels_last in (True, False)]
        variants.append(_variant(sized, views, False, chunk=max(1, views // 2)))
        variants += [_variant(sized, views, False, frozen=frozen) for frozen in FROZEN[1:]]
    return variants


def _variant(
    config: TrainingConfig, views: int, channels_last: bool, chunk: int = 0, frozen: int = 0
) -> TrainingConfig:
    return dataclasses.replace(
        config,
        batch=BatchConfig(places=views // 2, chunk=chunk),
        optimiser=dataclasses.replace(config.optimiser, frozen_groups=frozen, frozen_from=0.0),
        channels_last=channels_last,
        precision='fp32',
        threads=1,
        log_steps=1,
    )


def _row(config: TrainingConfig, steps: int) -> str:
    config = dataclasses.replace(config, steps=steps + 1)
    torch.manual_seed(config.seed)
    sampler = BatchSampler([_drive(lane_m, config.batch.places) for lane_m in (0.0, 5.0)], config.batch, config.seed)
    with tempfile.TemporaryDirectory() as folder:
        loop = Loop(config, make_objective(config), sampler, (), Path(folder), Group(0, 1, torch.device('cpu')))
        times_s: list[tuple[float, float]] = []
        loop.run(progress=lambda *_: times_s.append((time.perf_counter(), time.process_time())))
    # Between the ends of two steps, of which the first is the warm-up.
    wall_s, cpu_s = np.diff(times_s, axis=0).T / (2 * config.batch.places)
    low, median, high = np.quantile(1.0 / wall_s, (0.25, 0.5, 0.75))
    rows, columns = config.network.image_shape
    cells = [
        f'{config.network.backbone}, {rows} × {columns}',
        'channels last' if config.channels_last else 'channels first',
        f'{config.batch.chunk or 2 * config.batch.places} of {2 * config.batch.places}',
        f'{config.optimiser.frozen_groups}',
        f'{median:.2f}',
        f'{low:.2f} to {high:.2f}',
        f'{np.median(cpu_s):.3f} s',
    ]
    return '| ' + ' | '.join(cells) + ' |'


def _optimiser_time(side_px: int) -> str:
    config = read_config(PRESETS / f'{VGG16}.yaml')
    network = make_network(dataclasses.replace(config.network, side_px=side_px))
    for parameter in network.parameters():
        parameter.grad = torch.rand_like(parameter)
    steps = {
        name: torch.optim.AdamW(network.parameters(), fused=fused).step
        for name, fused in (('in one pass', True), ('operation by operation', False))
    }
    taken = interleaved(steps, repeats=5, warm_up=1)
    return f'{side_px} px: ' + ', '.join(f'{timing.median_ms:.0f} ms {name}' for name, timing in taken.items())


def _drive(lane_m: float, places: int) -> Drive:
    """A scan of noise at each place, 60 m apart."""
    rng = np.random.default_rng(int(lane_m))
    power = rng.integers(0, 120, (places, AZIMUTHS, RANGE_BINS), np.uint8)
    azimuths_rad = np.linspace(0.0, 2.0 * np.pi, AZIMUTHS, endpoint=False)
    poses = np.column_stack([60.0 * np.arange(places), np.full(places, lane_m), np.zeros(places)])
    return Drive(
        name=f'lane {lane_m:g}',
        world='noise',
        key='',
        stamps_ns=np.arange(places, dtype=np.int64),
        poses=poses,
        driven_m=poses[:, 0],
        kinds=np.full(places, ''),
        severities=np.zeros(places),
        read_scan=lambda row: PolarScan(row, power[row], azimuths_rad, RANGE_RESOLUTION_M),
    )


if __name__ == '__main__':
    main()
