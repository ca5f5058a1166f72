"""All settings of a training run, with the names of the keys in ``params/train/NAME.yaml``."""

from __future__ import annotations

import dataclasses

from offradar_ros.config import parameter
from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.encoders.registry import ENCODERS


@dataclasses.dataclass(frozen=True)
class DataConfig:
    """Training data: simulated worlds and recorded drives."""

    worlds: int = parameter(40, 'simulated worlds', minimum=0, maximum=100_000)
    first_seed: int = parameter(10_000, 'seed of the first world; the others follow', minimum=0, maximum=2**31)
    drives: int = parameter(4, 'drives through each world', minimum=1, maximum=100)
    scans: int = parameter(200, 'scans per drive', minimum=1, maximum=100_000)
    spacing_m: float = parameter(3.0, 'mean distance driven between two scans', unit='m', minimum=0.1, maximum=100.0)
    degraded: float = parameter(0.35, 'share of degraded scans', minimum=0.0, maximum=1.0)
    physics: str = parameter(
        'drawn', 'the radar: drawn for each world, or the same in all', choices=('nominal', 'drawn')
    )
    radars: int = parameter(
        1, 'radars that are drawn for each world; its drives take them in turn', minimum=1, maximum=100
    )
    bad_weather: float = parameter(0.2, 'share of drives in rain, snow or fog', minimum=0.0, maximum=1.0)
    sequences: tuple[str, ...] = parameter((), 'bags or data-set folders of recorded drives, with positions')
    split: str = parameter('', 'a split (name or YAML file) whose training sequences are used; empty for none')
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
    """Validation data: worlds and drives on which the network is never trained."""

    worlds: int = parameter(2, 'simulated worlds', minimum=0, maximum=1000)
    first_seed: int = parameter(900_000, 'seed of the first world; the others follow', minimum=0, maximum=2**31)
    drives: int = parameter(
        2, 'drives through each world; each is searched for in the map of every other', minimum=1, maximum=100
    )
    scans: int = parameter(150, 'scans per drive', minimum=1, maximum=100_000)
    spacing_m: float = parameter(4.0, 'mean distance driven between two scans', unit='m', minimum=0.1, maximum=100.0)
    degraded: float = parameter(0.35, 'share of degraded scans', minimum=0.0, maximum=1.0)
    physics: str = parameter(
        'drawn',
        'the radar: drawn for each world, the same in all, or one that training never uses',
        choices=('nominal', 'drawn', 'held_out'),
    )
    radars: int = parameter(
        1, 'radars that are drawn for each world; its drives take them in turn', minimum=1, maximum=100
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
    map_spacing_m: float = parameter(
        5.0, 'distance driven between two mapped scans', unit='m', minimum=0.1, maximum=100.0
    )
    every_steps: int = parameter(500, 'steps between validations', minimum=1, maximum=10**9)
    recall_weight: float = parameter(1.0, "weight of Recall@1 in a checkpoint's score", minimum=0.0, maximum=1e6)
    auroc_weight: float = parameter(
        1.0, "weight of the AUROC of U for wrong answers in a checkpoint's score", minimum=0.0, maximum=1e6
    )


@dataclasses.dataclass(frozen=True)
class BatchConfig:
    """How a batch is drawn: m places, two views of each."""

    places: int = parameter(32, 'm, places in a batch', minimum=2, maximum=4096)
    worlds: int = parameter(
        0,
        'worlds from which a batch is drawn (more if these are too small), 0 for all: with few worlds '
        'the negatives have the same streets and radar',
        minimum=0,
        maximum=100_000,
    )
    positive: str = parameter(
        'place',
        'second view of a place: from any drive within positive_m, or from the scans next to it in time',
        choices=('place', 'time'),
    )
    positive_m: float = parameter(
        20.0, 'greatest distance between two views of a place', unit='m', minimum=0.0, maximum=1000.0
    )
    positive_scans: int = parameter(
        1,
        'with positive: time, the second view is at most this number of scans earlier or later',
        minimum=1,
        maximum=1000,
    )
    negative_m: float = parameter(
        50.0, 'least distance between views of two places', unit='m', minimum=0.0, maximum=1e6
    )
    degraded_views: float = parameter(
        0.35, 'probability that a view is a degraded scan, if there is one', minimum=0.0, maximum=1.0
    )
    spin: bool = parameter(True, 'whether each view is rotated at random (an exact roll of its azimuths)')
    gain_db: float = parameter(
        0.0,
        "each view's gain is changed by a random number up to this, up or down",
        unit='dB',
        minimum=0.0,
        maximum=60.0,
    )
    floor_db: float = parameter(
        0.0,
        "noise up to this level, a random one, is added to each view's power",
        unit='dB',
        minimum=0.0,
        maximum=100.0,
    )
    knee_db: float = parameter(
        0.0,
        'the soft saturation of each view begins at a random level up to this far below the greatest, 127.5 dB',
        unit='dB',
        minimum=0.0,
        maximum=100.0,
    )
    chunk: int = parameter(
        0,
        'most views that pass the network at once, with the gradients of the whole batch (gradient caching); 0 for all',
        minimum=0,
        maximum=8192,
    )


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
        'U in the temperature of a pair: of each view, the greater for both views, or of each view with gradients '
        'for the greater alone',
        choices=('own', 'greater', 'worse'),
    )
    samples: int = parameter(4, 'samples of Z in the hedged criterion', minimum=1, maximum=1000)
    weight: float = parameter(1.0, "the term's weight; 0 leaves it out", minimum=0.0, maximum=1e9)


@dataclasses.dataclass(frozen=True)
class SeverityConfig:
    """The term that ranks U by the severity of degradation, for scans whose severity is known."""

    weight: float = parameter(0.0, "the term's weight; 0 leaves it out", minimum=0.0, maximum=1e9)
    margin: float = parameter(
        0.1, 'difference of log U beyond which a correctly ranked pair has hardly any loss', minimum=1e-6, maximum=1e6
    )


@dataclasses.dataclass(frozen=True)
class LossConfig:
    """The terms of the variational objective; the defaults are the paper's."""

    invariant: ContrastConfig = dataclasses.field(default_factory=lambda: ContrastConfig(on='z_i'))
    variant: ContrastConfig = dataclasses.field(default_factory=lambda: ContrastConfig(on='z', weight=0.1))
    severity: SeverityConfig = dataclasses.field(default_factory=SeverityConfig)
    kl_weight: float = parameter(1.0, 'weight of KL(N(μ, σ²) ‖ N(0, 1)), summed over d', minimum=0.0, maximum=1e9)
    kl_warmup_steps: int = parameter(0, 'steps over which kl_weight increases from 0', minimum=0, maximum=10**9)
    free_nats: float = parameter(0.0, 'the KL of a dimension has no gradient below this', minimum=0.0, maximum=1e6)
    reconstruction: str = parameter(
        'mse', 'error of the decoded feature map: mean square, or norm per scan', choices=('mse', 'l2')
    )
    reconstruction_weight: float = parameter(1.0, 'weight of that error', minimum=0.0, maximum=1e9)


@dataclasses.dataclass(frozen=True)
class OptimiserConfig:
    """The optimiser and the schedule of its learning rate."""

    name: str = parameter('adam', 'the optimiser', choices=('adam', 'adamw', 'muon'))
    learning_rate: float = parameter(1e-3, 'highest learning rate', minimum=0.0, maximum=100.0)
    matrix_rate: float = parameter(
        0.02, 'highest learning rate of matrices and kernels with muon', minimum=0.0, maximum=100.0
    )
    schedule: str = parameter(
        'one_cycle',
        'schedule of the learning rate; one_cycle and cosine end at 0',
        choices=('constant', 'one_cycle', 'cosine'),
    )
    warmup: float = parameter(
        0.25, 'share of the steps in which the rate of one_cycle increases', minimum=0.0, maximum=1.0
    )
    weight_decay: float = parameter(0.0, 'weight decay', minimum=0.0, maximum=100.0)
    clip_norm: float = parameter(10.0, 'norm to which gradients are clipped; 0 for no limit', minimum=0.0, maximum=1e9)
    average: float = parameter(
        0.0,
        'decay per step of the moving average of the weights that is validated and saved; 0 for none',
        minimum=0.0,
        maximum=0.999999,
    )
    frozen_groups: int = parameter(
        0, "the backbone's first groups of layers, of five, that are frozen late", minimum=0, maximum=5
    )
    frozen_from: float = parameter(0.5, 'share of the steps after which they are frozen', minimum=0.0, maximum=1.0)


TEACHERS = tuple(dict.fromkeys(entry.teacher for entry in ENCODERS.values() if entry.teacher))


@dataclasses.dataclass(frozen=True)
class TeacherConfig:
    """The teacher of a student (STUN): given weights, or a network that is trained first."""

    method: str = parameter('bc_radar', 'method of the teacher', choices=TEACHERS)
    weights: str = parameter('', 'weights of a trained teacher; if empty, one is trained first')
    steps: int = parameter(5000, 'training steps of the teacher', minimum=1, maximum=10**9)
    student: str = parameter(
        'fresh', "initial weights of the student: random, or the teacher's", choices=('fresh', 'teacher')
    )


@dataclasses.dataclass(frozen=True)
class DistillationConfig:
    """Terms that pull descriptor and variance (ours) to those that a trained network gives to the same scan."""

    weights: str = parameter(
        '', 'weights of the teacher, of any backbone and image: compact (those that ship) or a file; empty for none'
    )
    descriptor_weight: float = parameter(
        1.0, "weight of 1 − cos between the descriptor and the teacher's", minimum=0.0, maximum=1e9
    )
    variance_weight: float = parameter(
        0.1, "weight of the mean square difference of the log variance and the teacher's", minimum=0.0, maximum=1e9
    )


@dataclasses.dataclass(frozen=True)
class InitialConfig:
    """Where the network starts."""

    weights: str = parameter(
        '', 'weights of a network of the same method and backbone, for an image of any size; empty for random ones'
    )


@dataclasses.dataclass(frozen=True)
class RefinementConfig:
    """The second stage (ours): the variance head alone is trained with searches in maps of whole drives."""

    steps: int = parameter(0, 'steps of the second stage; 0 leaves it out', minimum=0, maximum=10**9)
    weights: str = parameter('', 'weights of a trained first stage; if empty, it is trained first')
    data: DataConfig = dataclasses.field(default_factory=lambda: DataConfig(worlds=20, first_seed=20_000))
    scans: int = parameter(512, 'scans in a batch', minimum=2, maximum=10**6)
    wrong_weight: float = parameter(0.5, 'weight of ranking U by the share of wrong answers', minimum=0.0, maximum=1e9)
    margin_weight: float = parameter(0.5, 'weight of ranking U by the margin of answers', minimum=0.0, maximum=1e9)
    severity_weight: float = parameter(0.5, 'weight of ranking U by severity', minimum=0.0, maximum=1e9)
    clean_weight: float = parameter(
        0.0,
        "weight of the square of each world's mean log U over clean scans that were found: U about 1 with every radar",
        minimum=0.0,
        maximum=1e9,
    )
    kl_weight: float = parameter(0.003, 'as loss.kl_weight', minimum=0.0, maximum=1e9)
    margin: float = parameter(0.1, 'as loss.severity.margin', minimum=1e-6, maximum=1e6)
    learning_rate: float = parameter(2e-4, 'first learning rate; it decreases to 0', minimum=0.0, maximum=100.0)
    weight_decay: float = parameter(0.05, 'weight decay', minimum=0.0, maximum=100.0)


@dataclasses.dataclass(frozen=True)
class TrainingConfig:
    """A training run."""

    fit: str = parameter(
        'network', "what is fitted: the network's weights, or the centres of rad_vlad", choices=('network', 'rad_vlad')
    )
    network: NetworkConfig = dataclasses.field(default_factory=NetworkConfig)
    data: DataConfig = dataclasses.field(default_factory=DataConfig)
    validation: ValidationConfig = dataclasses.field(default_factory=ValidationConfig)
    batch: BatchConfig = dataclasses.field(default_factory=BatchConfig)
    loss: LossConfig = dataclasses.field(default_factory=LossConfig)
    teacher: TeacherConfig = dataclasses.field(default_factory=TeacherConfig)
    distillation: DistillationConfig = dataclasses.field(default_factory=DistillationConfig)
    initial: InitialConfig = dataclasses.field(default_factory=InitialConfig)
    optimiser: OptimiserConfig = dataclasses.field(default_factory=OptimiserConfig)
    refinement: RefinementConfig = dataclasses.field(default_factory=RefinementConfig)
    steps: int = parameter(5000, 'training steps, one batch each', minimum=1, maximum=10**9)
    seed: int = parameter(1, 'seed of the initial weights, the batches and the samples', minimum=0, maximum=2**31)
    precision: str = parameter(
        'fp32',
        'precision of the network; bf16 and amp (fp16 with a scaled loss) are mixed',
        choices=('fp32', 'bf16', 'amp'),
    )
    cached_bin_m: float = parameter(
        0.0,
        'longest range bin of cached scans, for runs with images of other sizes to share them; 0 for half a pixel',
        unit='m',
        minimum=0.0,
        maximum=10.0,
    )
    channels_last: bool = parameter(True, 'whether convolutions run with the channels last in memory')
    threads: int = parameter(0, 'threads that make images; 0 for one per core', minimum=0, maximum=1024)
    checkpoint_steps: int = parameter(500, 'steps between checkpoints', minimum=1, maximum=10**9)
    log_steps: int = parameter(20, 'steps between lines of the log', minimum=1, maximum=10**9)

    @property
    def method(self) -> str:
        """The method of the network."""
        return self.network.method
