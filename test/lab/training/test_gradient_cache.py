"""Gradients of chunks against those of one graph, and a resumed run with chunks."""

from __future__ import annotations

import contextlib
import dataclasses
from pathlib import Path
from typing import Any

import pytest

torch = pytest.importorskip('torch')

from offradar_ros.encoders.network_config import NetworkConfig  # noqa: E402
from offradar_ros.encoders.networks.bc_radar import BcRadarNetwork  # noqa: E402
from offradar_ros.errors import ConfigError  # noqa: E402
from offradar_ros.lab.training.config import ContrastConfig, LossConfig, SeverityConfig, TrainingConfig  # noqa: E402
from offradar_ros.lab.training.gradient_cache import chunked_backward  # noqa: E402
from offradar_ros.lab.training.objective import Objective, Outputs, Views, losses_of, total_of  # noqa: E402
from offradar_ros.lab.training.objectives import make_objective  # noqa: E402
from offradar_ros.lab.training.parallel import Group  # noqa: E402
from offradar_ros.lab.training.run import RunOptions, run  # noqa: E402

LOSS = LossConfig(
    invariant=ContrastConfig(criterion='batch', on='z_i', temperature=0.5),
    variant=ContrastConfig(criterion='temperature', on='z', temperature=0.5, answers='greater'),
    severity=SeverityConfig(weight=0.3),
)
IMAGES = 10


def config_of(method: str, backbone: str, loss: LossConfig = LOSS) -> TrainingConfig:
    network = NetworkConfig(
        method=method, backbone=backbone, dimension=8, side_px=32, azimuths=32, range_bins=32, resolution_m=4.0
    )
    return TrainingConfig(network=network, loss=loss)


def objective_of(config: TrainingConfig) -> Objective:
    torch.manual_seed(4)
    student = config.method == 'stun'
    teacher = BcRadarNetwork(dataclasses.replace(config.network, method='bc_radar')) if student else None
    objective = make_objective(config, teacher)
    objective.network.train()
    return objective


def views_of() -> Views:
    generator = torch.Generator().manual_seed(1)
    images = torch.randint(0, 256, (IMAGES, 32, 32), dtype=torch.uint8, generator=generator)
    return Views(images, torch.rand(IMAGES, generator=generator))


def gradients(objective: Objective) -> dict[str, Any]:
    return {name: parameter.grad for name, parameter in objective.network.named_parameters()}


def buffers(objective: Objective) -> dict[str, Any]:
    return {name: buffer.clone() for name, buffer in objective.network.named_buffers()}


def assert_same(found: dict[str, Any], expected: dict[str, Any]) -> None:
    assert found.keys() == expected.keys()
    for name, tensor in found.items():
        other = expected[name]
        if tensor is None or other is None:
            assert tensor is None and other is None, name
        else:
            atol = 1e-4 * float(other.float().abs().max()) + 1e-9
            assert torch.allclose(tensor.float(), other.float(), rtol=1e-3, atol=atol), name


def in_one_graph(objective: Objective, views: Views, step: int, chunk: int) -> dict[str, Any]:
    """The terms of all chunks in one graph, with the order and the random numbers that they have in chunks."""
    order = torch.randperm(IMAGES)
    parts = order.tensor_split(-(-IMAGES // chunk))
    rows: list[Any] = [None] * IMAGES
    for part, seed in zip(parts, torch.randint(2**62, (len(parts),)).tolist(), strict=True):
        torch.manual_seed(seed)
        outputs = objective.outputs(views.images[part])
        for place, row in enumerate(part.tolist()):
            rows[row] = [output[place] for output in outputs]
    whole = tuple(torch.stack(column) for column in zip(*rows, strict=True))
    terms = objective.losses(whole, views, step)
    torch.autograd.backward(total_of(terms))
    return terms


@pytest.mark.parametrize('backbone', ['compact', 'vgg16'])
@pytest.mark.parametrize('method', ['variational', 'bc_radar', 'mc_dropout', 'stun', 'vae'])
@pytest.mark.parametrize('chunk', [3, 5])
def test_gradients_are_those_of_one_graph(method: str, backbone: str, chunk: int) -> None:
    views = views_of()
    one, cached = (objective_of(config_of(method, backbone)) for _ in range(2))
    torch.manual_seed(9)
    expected = in_one_graph(one, views, 0, chunk)
    torch.manual_seed(9)
    terms = chunked_backward(cached, views, 0, chunk)
    assert terms.keys() == expected.keys()
    for name, term in terms.items():
        assert term.item() == pytest.approx(expected[name].item(), rel=1e-4), name
    assert_same(gradients(cached), gradients(one))
    # Batch statistics are those of one pass, although there were two.
    assert_same(buffers(cached), buffers(one))


def test_without_batch_normalisation_and_samples_they_are_those_of_the_whole_batch() -> None:
    deterministic = dataclasses.replace(
        LOSS, variant=dataclasses.replace(LOSS.variant, on='mean'), reconstruction_weight=0.0
    )
    views = views_of()
    whole, cached = (objective_of(config_of('variational', 'vgg16', deterministic)) for _ in range(2))
    terms = losses_of(whole, views, 0)
    torch.autograd.backward(total_of(terms))
    found = chunked_backward(cached, views, 0, 4)
    for name, term in found.items():
        assert term.item() == pytest.approx(terms[name].item(), rel=1e-4), name
    assert_same(gradients(cached), gradients(whole))


def test_at_most_one_chunk_passes_the_network_and_is_scaled() -> None:
    sizes, scaled = [], []

    class Counting:
        """Counts the images of each pass."""

        def __init__(self) -> None:
            self._objective = objective_of(config_of('bc_radar', 'compact'))
            self.network = self._objective.network

        def outputs(self, images: Any) -> Outputs:
            sizes.append((len(images), torch.is_grad_enabled()))
            return self._objective.outputs(images)

        def losses(self, outputs: Outputs, views: Views, step: int) -> dict[str, Any]:
            return self._objective.losses(outputs, views, step)

    def scale(total: Any) -> Any:
        scaled.append(total.item())
        return total * 1024.0

    plain, counted = objective_of(config_of('bc_radar', 'compact')), Counting()
    torch.manual_seed(9)
    chunked_backward(plain, views_of(), 0, 4)
    torch.manual_seed(9)
    chunked_backward(counted, views_of(), 0, 4, contextlib.nullcontext, scale)
    assert sorted(sizes) == [(3, False), (3, False), (3, True), (3, True), (4, False), (4, True)]
    assert len(scaled) == 1
    expected = {name: gradient * 1024.0 for name, gradient in gradients(plain).items()}
    assert_same(gradients(counted), expected)


def test_mixed_precision_keeps_the_graph_of_the_second_pass() -> None:
    """Autocast keeps converted weights for as long as its context lasts: those of the first pass have no graph."""
    objective = objective_of(config_of('variational', 'vgg16'))
    chunked_backward(objective, views_of(), 0, 4, lambda: torch.autocast('cpu', dtype=torch.bfloat16))
    found = gradients(objective)
    assert all(gradient is not None and bool(gradient.abs().max() > 0.0) for gradient in found.values())
    assert {gradient.dtype for gradient in found.values()} == {torch.float32}


def test_chunks_are_refused_for_several_processes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    two = contextlib.nullcontext(Group(0, 2, torch.device('cpu')))
    monkeypatch.setattr('offradar_ros.lab.training.run.process_group', lambda device: two)
    config = config_of('variational', 'compact')
    config = dataclasses.replace(config, batch=dataclasses.replace(config.batch, chunk=4))
    with pytest.raises(ConfigError, match=r'key batch.chunk: expected 0 with 2 processes, got 4'):
        run(config, tmp_path / 'out', RunOptions(tmp_path / 'cache'))
    assert not (tmp_path / 'cache').exists()
