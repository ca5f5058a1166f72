"""The cost of a scan with each encoder, and by the size of the image: see README.md."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from drives import SEED, decoded_scans, simulated_drive
from machine_peaks import gigabytes_per_s, gigaflops
from measuring import cache_folder, interleaved, machine, rounded, single_threaded, write_results
from numpy.typing import NDArray
from sample_networks import exported, quantised, random_weights

from offradar_ros.config import EncoderConfig
from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.encoders.networks.mc_dropout import PASSES
from offradar_ros.encoders.onnx_backend import OnnxEncoder
from offradar_ros.encoders.opencv_backend import OpencvEncoder
from offradar_ros.encoders.pretrained import find_weights
from offradar_ros.encoders.rad_vlad import RadVladEncoder
from offradar_ros.encoders.rad_vlad_fit import fit_rad_vlad
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.types import PolarScan

RESULTS = Path(__file__).parent / 'results' / 'encoders.json'
PICTURE = Path(__file__).parents[1] / 'docs' / 'encoder_cost.png'
SCANS = 20
BATCH = 16
REPEATS, SECONDS = 40, 120.0
SIDES = (128, 192, 256, 320, 384)
POLAR = ((104, 64), (200, 128), (400, 256))

Encode = Callable[[PolarScan], object]


def full_passes(path: Path, device: str) -> Encode:
    """MC Dropout in every layer: the whole network runs T = 20 times, here as one batch."""
    encoder = OnnxEncoder(path, device=device)
    return lambda scan: encoder.infer(np.repeat(encoder.image(scan)[np.newaxis], PASSES, axis=0))


def encoders(folder: Path, drive: Path, scans: Sequence[PolarScan], device: str) -> dict[str, Encode]:
    """Ours and alternatives to it. Weights that do not ship are random, which takes as long."""
    weights = random_weights(folder, 'vgg16', NetworkConfig(backbone='vgg16'))
    vgg16, int8 = exported(weights, folder), quantised(weights, folder, drive)
    stun = exported(random_weights(folder, 'stun_resnet50', NetworkConfig(method='stun', backbone='resnet50')), folder)
    dropout = random_weights(folder, 'mc_dropout_vgg16', NetworkConfig(method='mc_dropout', backbone='vgg16'))
    return {
        'vgg16': OnnxEncoder(vgg16, device=device).encode,
        'vgg16_int8': OnnxEncoder(int8, device=device).encode,
        'compact': make_encoder(
            EncoderConfig(name='variational', weights='compact', backend='onnx', device=device)
        ).encode,
        'compact_opencv': OpencvEncoder(find_weights('compact', ('.onnx',))).encode,
        'stun_resnet50': OnnxEncoder(stun, device=device).encode,
        'mc_dropout_head': OnnxEncoder(exported(dropout, folder), device=device).encode,
        'mc_dropout_full': full_passes(vgg16, device),
        'rad_vlad': RadVladEncoder(fit_rad_vlad(iter(scans), SEED)).encode,
        'ring_key': make_encoder(EncoderConfig(name='ring_key')).encode,
    }


class RoundRobin:
    """Calls a function with the next scan each time."""

    def __init__(self, encode: Encode, scans: Sequence[PolarScan]) -> None:
        self._encode, self._scans, self._next = encode, scans, 0

    def __call__(self) -> object:
        """The function's result for the next scan."""
        self._next += 1
        return self._encode(self._scans[self._next % len(self._scans)])


def multiplications(path: Path) -> int:
    """Multiply-adds of one image in convolutions and matrix products, which are nearly all."""
    model = onnx.load(path)
    model.graph.input[0].type.tensor_type.shape.dim[0].dim_value = 1
    graph = onnx.shape_inference.infer_shapes(model, data_prop=True).graph
    sizes = {tensor.name: list(tensor.dims) for tensor in graph.initializer}
    for value in (*graph.input, *graph.value_info, *graph.output):
        sizes[value.name] = [dimension.dim_value or 1 for dimension in value.type.tensor_type.shape.dim]
    total = 0
    for node in graph.node:
        if node.op_type == 'Conv':
            total += int(np.prod(sizes[node.input[1]][1:]) * np.prod(sizes[node.output[0]]))
        elif node.op_type == 'Gemm':
            total += int(np.prod(sizes[node.input[1]]))
        elif node.op_type == 'MatMul':
            total += int(sizes[node.input[0]][-1] * np.prod(sizes[node.output[0]]))
    return total


def in_batches(folder: Path, drive: Path, device: str) -> dict[str, dict[str, Any]]:
    """Images per second in batches, as evaluations encode them."""
    weights = random_weights(folder, 'vgg16', NetworkConfig(backbone='vgg16'))
    networks = {
        'vgg16': OnnxEncoder(exported(weights, folder), device=device),
        'vgg16_int8': OnnxEncoder(quantised(weights, folder, drive), device=device),
        'compact': OnnxEncoder(find_weights('compact', ('.onnx',)), device=device),
    }
    rng = np.random.default_rng(SEED)
    calls = {
        name: _infer(network, rng.integers(0, 255, (BATCH, *network.header.config.image_shape), dtype=np.uint8))
        for name, network in networks.items()
    }
    timings = interleaved(calls, REPEATS, seconds=SECONDS / 4)
    return {
        name: {'batch': BATCH, 'images_per_s': rounded(BATCH / timing.median_ms * 1e3), **timing.as_dict()}
        for name, timing in timings.items()
    }


def image_sizes(folder: Path, drive: Path, device: str) -> dict[str, dict[str, Any]]:
    """Time of the network alone by the size of its image."""
    files: dict[str, tuple[Path, tuple[int, int]]] = {}
    for side in SIDES:
        weights = random_weights(folder, f'vgg16_{side}', NetworkConfig(backbone='vgg16', side_px=side))
        files[f'vgg16 {side}'] = exported(weights, folder), (side, side)
        files[f'vgg16_int8 {side}'] = quantised(weights, folder, drive), (side, side)
    for rows, columns in POLAR:
        config = NetworkConfig(backbone='compact', azimuths=rows, range_bins=columns)
        files[f'compact {rows}'] = exported(random_weights(folder, f'compact_{rows}', config), folder), (rows, columns)
    rng = np.random.default_rng(SEED)
    calls: dict[str, Callable[[], object]] = {}
    for name, (path, shape) in files.items():
        encoder, image = OnnxEncoder(path, device=device), rng.integers(0, 255, (1, *shape), dtype=np.uint8)
        calls[name] = _infer(encoder, image)
    timings = interleaved(calls, REPEATS, seconds=SECONDS)
    return {
        name: {
            'network': name.split()[0],
            'pixels': shape[0] * shape[1],
            **timings[name].as_dict(),
            'gigaflop': rounded(2e-9 * multiplications(path)) if 'int8' not in name else None,
            'file_mb': rounded(path.stat().st_size / 1e6),
        }
        for name, (path, shape) in files.items()
    }


def _infer(encoder: OnnxEncoder, image: NDArray[np.uint8]) -> Callable[[], object]:
    return lambda: encoder.infer(image)


def draw(sizes: Mapping[str, Mapping[str, Any]], peak_gflops: float, bandwidth_gb_s: float, picture: Path) -> None:
    """Draw milliseconds against pixels, with the lower bounds of the machine."""
    import matplotlib  # noqa: PLC0415

    matplotlib.use('Agg')
    from matplotlib import pyplot  # noqa: PLC0415

    cores = machine()['cores']
    figure, axes = pyplot.subplots(figsize=(8, 5), layout='constrained')
    for network in dict.fromkeys(row['network'] for row in sizes.values()):
        rows = [row for row in sizes.values() if row['network'] == network]
        pixels = [row['pixels'] for row in rows]
        (line,) = axes.plot(pixels, [row['median_ms'] for row in rows], 'o-', label=network)
        if all(row['gigaflop'] for row in rows):
            floor = [row['gigaflop'] / peak_gflops / cores * 1e3 for row in rows]
            axes.plot(
                pixels,
                floor,
                ':',
                color=line.get_color(),
                label=f'{network}: its products at {peak_gflops:.0f} GFLOP/s',
            )
        reading = [row['file_mb'] / bandwidth_gb_s for row in rows]
        axes.plot(
            pixels,
            reading,
            '--',
            color=line.get_color(),
            lw=0.8,
            label=f'{network}: its weights at {bandwidth_gb_s:.0f} GB/s',
        )
    axes.set(
        xscale='log',
        yscale='log',
        xlabel='pixels of the image',
        ylabel=f'ms per scan, {cores} cores',
        title='The network alone',
    )
    axes.grid(alpha=0.3, which='both')
    axes.legend(fontsize=7)
    figure.savefig(picture, dpi=110)


def main() -> None:
    """Print a table, and write results and picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--folder', type=Path, default=Path('build/bench'), help='where drives and networks are kept')
    parser.add_argument('--device', default='cpu', choices=('cpu', 'cuda'), help='where networks run (default cpu)')
    parser.add_argument('--out', type=Path, default=RESULTS, help='default: the results in the repository')
    parser.add_argument('--picture', type=Path, default=PICTURE, help='default: the one in docs')
    arguments = parser.parse_args()
    folder = cache_folder(arguments.folder)
    drive = simulated_drive(folder)
    scans = decoded_scans(drive, SCANS)
    timings = interleaved(
        {name: RoundRobin(encode, scans) for name, encode in encoders(folder, drive, scans, arguments.device).items()},
        REPEATS,
        seconds=SECONDS,
    )
    reference = timings['vgg16'].median_ms
    print(f'{"encoder":16} {"median":>10} {"quartiles":>20} {"p99":>10} {"of vgg16":>9}')
    for name, timing in timings.items():
        quartiles = '{:.1f} to {:.1f} ms'.format(*timing.quartiles_ms)
        share = timing.median_ms / reference
        print(f'{name:16} {timing.median_ms:7.1f} ms {quartiles:>20} {timing.p99_ms:7.1f} ms {share:9.3f}')
    batches, sizes = in_batches(folder, drive, arguments.device), image_sizes(folder, drive, arguments.device)
    peak, bandwidth = gigaflops(), gigabytes_per_s()
    for name, row in batches.items():
        print(f'{name:16} {row["images_per_s"]:7.1f} images/s in batches of {row["batch"]}')
    for name, row in sizes.items():
        print(f'{name:16} {row["median_ms"]:7.1f} ms')
    write_results(
        arguments.out,
        {
            'encoders': {
                name: timing.as_dict() | {'ratio_to_vgg16': rounded(timing.median_ms / reference)}
                for name, timing in timings.items()
            },
            'device': arguments.device,
            'batches': batches,
            'image_sizes': sizes,
            'peak_gflops': rounded(peak),
            'read_gb_s': rounded(bandwidth),
        },
        {'drive': SEED, 'weights': SEED, 'images': SEED},
    )
    draw(sizes, peak, bandwidth, arguments.picture)


if __name__ == '__main__':
    single_threaded()
    main()
