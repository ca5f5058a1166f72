"""All settings of a training run: what ``params/train/NAME.yaml`` holds, under the same names."""

from __future__ import annotations

import dataclasses

from offradar_ros.config import parameter
from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.encoders.registry import ENCODERS


@dataclasses.dataclass(frozen=True)
class DataConfig:
    """What scans there are to learn from: simulated worlds and recorded drives."""

    worlds: int = parameter(40, 'simulated worlds', minimum=0, maximum=100_000)
    first_seed: int = parameter(10_000, 'seed of the first world; the others follow', minimum=0, maximum=2**31)
    drives: int = parameter(4, 'drives through each world', minimum=1, maximum=100)
    scans: int = parameter(200, 'scans a drive', minimum=1, maximum=100_000)
    spacing_m: float = parameter(3.0, 'mean distance driven between two scans', unit='m', minimum=0.1, maximum=100.0)
    degraded: float = parameter(0.35, 'share of degraded scans', minimum=0.0, maximum=1.0)
    physics: str = parameter(
        'drawn', 'of the radar: drawn for each world, or the same in all', choices=('nominal', 'drawn')
    )
    bad_weather: float = parameter(0.2, 'share of drives in rain, snow or fog', minimum=0.0, maximum=1.0)
    sequences: tuple[str, ...] = parameter((), 'bags or data-set folders of recorded drives, with positions')
    split: str = parameter('', 'a split (name or YAML file) whose training sequences are learnt from; empty for none')
    root: str = parameter('', 'folder that holds the sequences of the split')
    sequence_spacing_m: float = parameter(
        1.0,
        'mean distance driven between two recorded scans that are kept, 0 for all',
        unit='m',
        minimum=0.0,
        maximum=100,
    )


@dataclasses.dataclass(frozen=True)
class ValidationConfig:
    """What the checkpoints are validated on: worlds and drives that are never trained on."""

    worlds: int = parameter(2, 'simulated worlds', minimum=0, maximum=1000)
    first_seed: int = parameter(900_000, 'seed of the first world; the others follow', minimum=0, maximum=2**31)
    drives: int = parameter(2, 'drives through each world; each is searched from every other', minimum=1, maximum=100)
    scans: int = parameter(150, 'scans a drive', minimum=1, maximum=100_000)
    spacing_m: float = parameter(4.0, 'mean distance driven between two scans', unit='m', minimum=0.1, maximum=100.0)
    degraded: float = parameter(0.35, 'share of degraded scans', minimum=0.0, maximum=1.0)
    physics: str = parameter(
        'drawn',
        'of the radar: drawn for each world, the same in all, or never trained on',
        choices=('nominal', 'drawn', 'held_out'),
    )
    bad_weather: float = parameter(0.2, 'share of drives in rain, snow or fog', minimum=0.0, maximum=1.0)
    sequences: tuple[str, ...] = parameter((), 'bags or data-set folders of recorded drives, with positions')
    sequence_spacing_m: float = parameter(
        1.0,
        'mean distance driven between two recorded scans that are kept, 0 for all',
        unit='m',
        minimum=0.0,
        maximum=100,
    )
    map_spacing_m: float = parameter(5.0, 'one scan in so many metres is mapped', unit='m', minimum=0.1, maximum=100.0)
    every_steps: int = parameter(500, 'steps between validations', minimum=1, maximum=10**9)
    recall_weight: float = parameter(1.0, "of Recall@1 in a checkpoint's score", minimum=0.0, maximum=1e6)
    auroc_weight: float = parameter(
        1.0, "of the AUROC of U for wrong answers in a checkpoint's score", minimum=0.0, maximum=1e6
    )


@dataclasses.dataclass(frozen=True)
class BatchConfig:
    """How a batch is drawn: m places, each seen twice."""

    places: int = parameter(32, 'm, places in a batch', minimum=2, maximum=4096)
    worlds: int = parameter(
        0,
        'worlds that a batch is drawn from, more only where they are too small, 0 for any: in few, '
        'the negatives are from the same streets and radar',
        minimum=0,
        maximum=100_000,
    )
    positive: str = parameter(
        'place',
        'where the second view of a place is from: any drive within positive_m, or the scans next to it in time',
        choices=('place', 'time'),
    )
    positive_m: float = parameter(
        20.0, 'the second view is from nearer than this', unit='m', minimum=0.0, maximum=1000.0
    )
    positive_scans: int = parameter(1, 'the second view is at most so many scans away in time', minimum=1, maximum=1000)
    negative_m: float = parameter(
        50.0, 'views of two places are further apart than this', unit='m', minimum=0.0, maximum=1e6
    )
    degraded_views: float = parameter(
        0.35, 'chance that a view is taken from the degraded scans there are', minimum=0.0, maximum=1.0
    )
    spin: bool = parameter(True, 'whether each view is turned at random (an exact roll of its azimuths)')


@dataclasses.dataclass(frozen=True)
class ContrastConfig:
    """One contrastive term."""

    criterion: str = parameter(
        'batch',
        "batch: Ye et al.'s; temperature: NT-Xent with each row's U as its temperature; hedged: match "
        'probability averaged over samples of Z',
        choices=('batch', 'temperature', 'hedged'),
    )
    on: str = parameter('z', 'what is compared: Z_I, E[Z] = Z_I + μ, or a sample of Z', choices=('z_i', 'mean', 'z'))
    temperature: float = parameter(1.0, 'τ', minimum=1e-6, maximum=1e6)
    negative_weight: float = parameter(0.1, 'weight of the negatives in the batch criterion', minimum=0.0, maximum=1e6)
    answers: str = parameter(
        'own',
        'whose U the temperature of a pair is: each its own, the greater for both, or its own, of which only the worse '
        'learns',
        choices=('own', 'greater', 'worse'),
    )
    samples: int = parameter(4, 'samples of Z in the hedged criterion', minimum=1, maximum=1000)
    weight: float = parameter(1.0, "the term's weight; 0 leaves it out", minimum=0.0, maximum=1e9)


@dataclasses.dataclass(frozen=True)
class SeverityConfig:
    """The term by which U learns to rank scans by how badly they are degraded, where the simulator says so."""

    weight: float = parameter(0.0, "the term's weight; 0 leaves it out", minimum=0.0, maximum=1e9)
    margin: float = parameter(
        0.1, 'difference of log U beyond which a pair that is ranked rightly hardly counts', minimum=1e-6, maximum=1e6
    )


@dataclasses.dataclass(frozen=True)
class LossConfig:
    """The terms of the variational objective; the defaults are the paper's."""

    invariant: ContrastConfig = dataclasses.field(default_factory=lambda: ContrastConfig(on='z_i'))
    variant: ContrastConfig = dataclasses.field(default_factory=lambda: ContrastConfig(on='z', weight=0.1))
    severity: SeverityConfig = dataclasses.field(default_factory=SeverityConfig)
    kl_weight: float = parameter(1.0, 'weight of KL(N(μ, σ²) ‖ N(0, 1)), summed over d', minimum=0.0, maximum=1e9)
    kl_warmup_steps: int = parameter(0, 'steps over which that weight rises from 0', minimum=0, maximum=10**9)
    free_nats: float = parameter(0.0, 'KL of a dimension below this costs nothing', minimum=0.0, maximum=1e6)
    reconstruction: str = parameter(
        'mse', 'error of the decoded feature map: mean square, or norm a scan', choices=('mse', 'l2')
    )
    reconstruction_weight: float = parameter(1.0, 'its weight', minimum=0.0, maximum=1e9)


@dataclasses.dataclass(frozen=True)
class OptimiserConfig:
    """Gradient descent."""

    name: str = parameter('adam', 'which', choices=('adam', 'adamw'))
    learning_rate: float = parameter(1e-3, 'its highest value', minimum=0.0, maximum=100.0)
    schedule: str = parameter(
        'one_cycle', 'how it changes: one_cycle and cosine fall to 0', choices=('constant', 'one_cycle', 'cosine')
    )
    warmup: float = parameter(0.25, 'share of the steps in which one_cycle rises', minimum=0.0, maximum=1.0)
    weight_decay: float = parameter(0.0, 'of the weights', minimum=0.0, maximum=100.0)
    clip_norm: float = parameter(10.0, 'longest gradient; 0 for any', minimum=0.0, maximum=1e9)


TEACHERS = tuple(dict.fromkeys(entry.teacher for entry in ENCODERS.values() if entry.teacher))


@dataclasses.dataclass(frozen=True)
class TeacherConfig:
    """Whom a student (STUN) learns from: weights, or a teacher that is trained first."""

    method: str = parameter('bc_radar', 'method that trains the teacher', choices=TEACHERS)
    weights: str = parameter('', 'weights of a teacher trained before; empty trains one')
    steps: int = parameter(5000, 'steps that the teacher is trained for', minimum=1, maximum=10**9)
    student: str = parameter(
        'fresh', "what the student starts from: weights of its own, or the teacher's", choices=('fresh', 'teacher')
    )


@dataclasses.dataclass(frozen=True)
class RefinementConfig:
    """A second stage of ours: searches through whole maps teach the variance head, and nothing else, what is found."""

    steps: int = parameter(0, 'steps of the second stage; 0 leaves it out', minimum=0, maximum=10**9)
    weights: str = parameter('', 'weights of a first stage trained before; empty trains it')
    data: DataConfig = dataclasses.field(default_factory=lambda: DataConfig(worlds=20, first_seed=20_000))
    scans: int = parameter(512, 'scans in a batch', minimum=2, maximum=10**6)
    wrong_weight: float = parameter(
        0.5, 'of ranking U by how often a scan is answered wrongly', minimum=0.0, maximum=1e9
    )
    margin_weight: float = parameter(
        0.5, 'of ranking U by how near scans come to being answered wrongly', minimum=0.0, maximum=1e9
    )
    severity_weight: float = parameter(0.5, 'of ranking U by severity', minimum=0.0, maximum=1e9)
    kl_weight: float = parameter(0.003, 'as loss.kl_weight', minimum=0.0, maximum=1e9)
    margin: float = parameter(0.1, 'as loss.severity.margin', minimum=1e-6, maximum=1e6)
    learning_rate: float = parameter(2e-4, 'its first value; it falls to 0', minimum=0.0, maximum=100.0)
    weight_decay: float = parameter(0.05, 'of the weights', minimum=0.0, maximum=100.0)


@dataclasses.dataclass(frozen=True)
class TrainingConfig:
    """A training run."""

    fit: str = parameter(
        'network', "what learns: the network's weights, or the centres of rad_vlad", choices=('network', 'rad_vlad')
    )
    network: NetworkConfig = dataclasses.field(default_factory=NetworkConfig)
    data: DataConfig = dataclasses.field(default_factory=DataConfig)
    validation: ValidationConfig = dataclasses.field(default_factory=ValidationConfig)
    batch: BatchConfig = dataclasses.field(default_factory=BatchConfig)
    loss: LossConfig = dataclasses.field(default_factory=LossConfig)
    teacher: TeacherConfig = dataclasses.field(default_factory=TeacherConfig)
    optimiser: OptimiserConfig = dataclasses.field(default_factory=OptimiserConfig)
    refinement: RefinementConfig = dataclasses.field(default_factory=RefinementConfig)
    steps: int = parameter(5000, 'batches to learn from', minimum=1, maximum=10**9)
    seed: int = parameter(1, 'of the initial weights, the batches and the samples', minimum=0, maximum=2**31)
    precision: str = parameter(
        'fp32', 'of the network: bf16 and amp (fp16, loss scaled) are mixed', choices=('fp32', 'bf16', 'amp')
    )
    channels_last: bool = parameter(True, 'whether convolutions run with the channels last in memory')
    threads: int = parameter(0, 'threads that make images; 0 for one a core', minimum=0, maximum=1024)
    checkpoint_steps: int = parameter(500, 'steps between checkpoints', minimum=1, maximum=10**9)
    log_steps: int = parameter(20, 'steps between lines of the log', minimum=1, maximum=10**9)

    @property
    def method(self) -> str:
        """What is trained: the method of the network."""
        return self.network.method
