"""Configuration: a frozen dataclass for each stage, with the same dotted names in Python, YAML and ROS parameters.

Each field carries its description, unit and bounds. `load_config` reads the YAML that ROS nodes read
(``/**: ros__parameters:``) or the same names without that wrapping.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

from offradar_ros.bounded_input import parse_yaml
from offradar_ros.errors import ConfigError
from offradar_ros.positions.headings import CHOICES as HEADING_CHOICES
from offradar_ros.records import flatten, read_tree, replace, to_yaml
from offradar_ros.whole_file import write_whole_file
from offradar_ros.yaml_digest import digest_line

Value = bool | int | float | str
NODE_PARAMETERS = frozenset({'use_sim_time', 'autostart', 'start_type_description_service'})
NODE_PARAMETER_PREFIX = 'qos_overrides.'
REMOVED = {'query.storage': 'maps are always searched in float32, the former default'}
"""Parameters of earlier versions that no longer exist, and why."""
ConfigT = TypeVar('ConfigT')


@dataclasses.dataclass(frozen=True)
class Bounds:
    """Description, unit and allowed values of a parameter; `read_only` ones cannot change while a node runs."""

    description: str
    unit: str = ''
    minimum: float | None = None
    maximum: float | None = None
    choices: tuple[str, ...] = ()
    read_only: bool = True

    def problem(self, value: Value) -> str | None:
        """Why `value` is not allowed, or None."""
        if isinstance(value, int) and value.bit_length() > 63:
            return 'expected a number of 64 bits, as in ROS parameters'
        if self.choices and value not in self.choices:
            return f'expected one of {", ".join(self.choices)}, got {value!r}'
        if isinstance(value, float) and not math.isfinite(value):
            return f'expected a finite number, got {value}'
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            if self.minimum is not None and value < self.minimum:
                return f'expected at least {self.minimum:g} {self.unit}'.rstrip() + f', got {value:g}'
            if self.maximum is not None and value > self.maximum:
                return f'expected at most {self.maximum:g} {self.unit}'.rstrip() + f', got {value:g}'
        return None


def parameter(
    default: Any,
    description: str,
    *,
    unit: str = '',
    minimum: float | None = None,
    maximum: float | None = None,
    choices: tuple[str, ...] = (),
    read_only: bool = True,
) -> Any:
    """A dataclass field that is also a ROS parameter; `read_only=False` ones may be changed while a node runs."""
    bounds = Bounds(description, unit, minimum, maximum, choices, read_only)
    return dataclasses.field(default=default, metadata={'bounds': bounds})


@dataclasses.dataclass(frozen=True)
class RadarConfig:
    """How polar images are decoded."""

    profile: str = parameter(
        'auto',
        'sensor profile; auto recognises a recorded format by its number of range bins',
        choices=('auto', 'cts350x', 'cir204h', 'radiate', 'navtech_300m', 'custom'),
    )
    range_resolution_m: float = parameter(
        0.0, 'size of a range bin; 0 takes it from the profile', unit='m', minimum=0.0, maximum=10.0
    )
    range_offset_m: float = parameter(0.0, 'added to every range', unit='m', minimum=-100.0, maximum=100.0)
    azimuth_axis: str = parameter(
        'auto',
        'whether azimuths are image rows (Navtech driver) or columns (MulRan player)',
        choices=('auto', 'rows', 'columns'),
    )
    azimuth_samples: int = parameter(400, 'azimuths in a full rotation', minimum=8, maximum=16384)
    metadata_columns: str = parameter(
        'auto',
        'whether each row starts with the 11 bytes of stamp, encoder and validity of the Oxford PNG layout',
        choices=('auto', '0', '11'),
    )
    encoder_size: int = parameter(
        5600, 'encoder counts in a full rotation, for metadata columns', unit='counts', minimum=8, maximum=65536
    )
    row_angles: str = parameter(
        'encoder',
        'whether the angles of rows with metadata columns are those of their encoder counts, or equal steps from 0',
        choices=('encoder', 'equal'),
    )
    azimuth_offset_rad: float = parameter(
        0.0,
        "azimuth of row 0, clockwise from the vehicle's forward axis",
        unit='rad',
        minimum=-math.tau,
        maximum=math.tau,
    )
    azimuth_direction: str = parameter(
        'clockwise',
        'direction in which azimuths increase with rows, seen from above',
        choices=('clockwise', 'counterclockwise'),
    )
    transport: str = parameter(
        'raw',
        'what the encoder node reads: the Image on radar_data/b_scan_image, or the CompressedImage, a PNG, on '
        'radar_data/b_scan_image/compressed',
        choices=('raw', 'compressed'),
    )
    max_image_bytes: int = parameter(
        64 * 2**20, 'larger images are refused', unit='bytes', minimum=1024, maximum=2**31 - 1
    )
    restart_after_s: float = parameter(
        1.0,
        'a stamp that jumps back by more than this means that the recording starts again; a smaller jump is an error',
        unit='s',
        minimum=0.0,
        maximum=1e6,
    )


@dataclasses.dataclass(frozen=True)
class CartesianConfig:
    """The Cartesian image that the paper's backbone sees (Sec. IV-D: 256 px, 0.5 m)."""

    side_px: int = parameter(256, 'side of the square image', unit='px', minimum=16, maximum=2048)
    resolution_m: float = parameter(0.5, 'side of a pixel', unit='m', minimum=0.01, maximum=10.0)
    min_range_m: float = parameter(
        2.5, 'nearer returns are of the vehicle itself and are blanked', unit='m', minimum=0.0, maximum=50.0
    )


@dataclasses.dataclass(frozen=True)
class PolarGridConfig:
    """The polar image that the compact encoder sees."""

    azimuths: int = parameter(200, 'rows: equal sectors of a full turn', minimum=8, maximum=4096)
    range_bins: int = parameter(128, 'columns', minimum=8, maximum=4096)
    resolution_m: float = parameter(0.5, 'range interval of a column', unit='m', minimum=0.01, maximum=10.0)
    min_range_m: float = parameter(
        2.5, 'nearer returns are of the vehicle itself and are blanked', unit='m', minimum=0.0, maximum=50.0
    )


@dataclasses.dataclass(frozen=True)
class RingKeyConfig:
    """The ring key encoder, which needs no weights."""

    rings: int = parameter(128, 'dimension of the embedding', minimum=8, maximum=4096)
    max_range_m: float = parameter(128.0, 'outer edge of the last ring', unit='m', minimum=1.0, maximum=1000.0)
    min_range_m: float = parameter(
        2.5, 'nearer returns are of the vehicle itself and are blanked', unit='m', minimum=0.0, maximum=50.0
    )
    sectors: int = parameter(
        20, 'number of azimuth sectors, whose differences give the variance', minimum=2, maximum=400
    )
    # The result of `offradar calibrate` on a clean drive of `offradar simulate`.
    variance_scale: float = parameter(
        2.55,
        'factor that makes U 1 on average over a calibration drive (offradar calibrate)',
        minimum=1e-12,
        maximum=1e12,
    )


@dataclasses.dataclass(frozen=True)
class EncoderConfig:
    """Which encoder is used, and what it runs on."""

    name: str = parameter(
        'variational',
        'name of the encoder, which makes an embedding of each scan (docs/encoders.md)',
    )
    weights: str = parameter(
        'compact',
        'weights of a learned encoder: a .onnx or .safetensors file, or the name of weights that the package includes',
    )
    backend: str = parameter(
        'auto',
        'runtime of a learned encoder; auto takes the first of ONNX Runtime, OpenCV and torch that is installed and '
        'reads the weights file',
        choices=('auto', 'onnx', 'opencv', 'torch'),
    )
    device: str = parameter(
        'auto',
        'device of a learned encoder; auto takes a GPU if its backend finds one, cuda requires one',
        choices=('auto', 'cpu', 'cuda'),
    )
    threads: int = parameter(0, 'inference threads; 0 uses every core', minimum=0, maximum=1024)
    backlog: int = parameter(
        1,
        'number of scans that may wait while one is encoded; when another arrives, the oldest waiting one is dropped',
        minimum=1,
        maximum=1000,
    )
    signature: bool = parameter(
        True,
        'whether each embedding carries a signature of its scan, by which a match is aligned with its place (2 to 3 kB '
        'for each scan and each place of the map)',
    )
    ring_key: RingKeyConfig = dataclasses.field(default_factory=RingKeyConfig)


@dataclasses.dataclass(frozen=True)
class PositionConfig:
    """Source of positions, and how long they are valid. Only the map server uses positions; queries need none."""

    source: str = parameter('fix', 'type of the position topic: NavSatFix or Odometry', choices=('fix', 'odometry'))
    heading: str = parameter(
        'auto',
        'heading of places: auto is that of the source where it has one, else the course over ground; source, course: '
        'that alone; none: unknown',
        choices=HEADING_CHOICES,
    )
    max_gap_s: float = parameter(
        1.5, 'largest time between two positions between which is interpolated', unit='s', minimum=0.01, maximum=60.0
    )
    wait_s: float = parameter(
        10.0,
        'a scan without a position is dropped when another scan is newer by more than this',
        unit='s',
        minimum=0.0,
        maximum=600.0,
    )
    restart_after_s: float = parameter(
        1.0,
        'a position stamp that jumps back by more than this means that the recording starts again; a smaller jump is '
        'an error',
        unit='s',
        minimum=0.0,
        maximum=1e6,
    )


@dataclasses.dataclass(frozen=True)
class MapConfig:
    """Map maintenance (Algorithm 1 of the paper)."""

    path: str = parameter('', 'SQLite file of the map; empty keeps the map in memory only')
    match_distance_m: float = parameter(
        5.0, 'D_t: a scan nearer than this to a place matches it', unit='m', minimum=0.01, maximum=1000.0
    )
    replace: str = parameter(
        'nearest',
        'which of several matching places a more certain scan may replace',
        choices=('nearest', 'worst', 'all'),
    )
    match_position: str = parameter(
        'anchor',
        'the position of a place for D_t: where it was first mapped, or that of the scan that it holds now',
        choices=('anchor', 'pose'),
    )
    replace_margin: float = parameter(
        0.0, 'a scan replaces a place only if its U is lower by more than this', minimum=0.0, maximum=1e6
    )
    insert_unmatched: bool = parameter(True, 'whether a scan that matches no place becomes one (false: constant size)')
    undo_depth: int = parameter(3, 'ended sessions that can be undone', minimum=0, maximum=1000)
    start_session: bool = parameter(True, 'whether a session starts with the node')
    allow_destructive: bool = parameter(
        False, 'whether the services undo_session and clear, which take mapped drives away, do so for any caller'
    )
    autosave_s: float = parameter(
        10.0,
        'how often the running session is saved to disk; 0 turns this off',
        unit='s',
        minimum=0.0,
        maximum=3600.0,
    )


@dataclasses.dataclass(frozen=True)
class ConfidenceConfig:
    """Log-odds that an answer is right, a sum of evidence (docs/confidence.md).

    No coefficient of a distance or an uncertainty is positive. That of the score at the place is not negative, and that
    of scores elsewhere is not positive.
    """

    model: str = parameter(
        '',
        'fingerprint of the model that these coefficients are for (offradar calibrate); empty takes those that ship '
        'for the model of the map',
        read_only=False,
    )
    base_rate: float = parameter(
        0.5,
        'share of right answers among those that the coefficients were fitted to, on the map and off it; what a scan '
        'tells a belief over many is how much more probable than this its answer is',
        minimum=1e-6,
        maximum=1.0 - 1e-6,
        read_only=False,
    )
    intercept: float = parameter(
        0.0, 'log-odds of an answer whose other terms are 0', minimum=-1e6, maximum=1e6, read_only=False
    )
    distance: float = parameter(
        0.0,
        'times the distance of the nearest place in embedding space: how little the scan resembles it',
        minimum=-1e6,
        maximum=0.0,
        read_only=False,
    )
    spatial_ratio: float = parameter(
        0.0,
        'times the log of that distance over the distance of the nearest place elsewhere: how little better it '
        'resembles this place than another',
        minimum=-1e6,
        maximum=0.0,
        read_only=False,
    )
    place_ratio: float = parameter(
        0.0,
        'times the log of that distance over the distance from the place to the nearest place elsewhere: how little '
        'better than two places of the map resemble each other',
        minimum=-1e6,
        maximum=0.0,
        read_only=False,
    )
    uncertainty: float = parameter(0.0, 'times the log of U of the scan', minimum=-1e6, maximum=0.0, read_only=False)
    place_uncertainty: float = parameter(
        0.0, 'times the log of U of the scan that the place holds', minimum=-1e6, maximum=0.0, read_only=False
    )
    verified_intercept: float = parameter(
        0.0,
        'log-odds where the scan was aligned with that of the place, of an answer whose other terms are 0',
        minimum=-1e6,
        maximum=1e6,
        read_only=False,
    )
    verified_log_odds: float = parameter(
        1.0,
        'times the log-odds of all evidence above, where the scan was aligned',
        minimum=0.0,
        maximum=1e6,
        read_only=False,
    )
    score: float = parameter(
        0.0,
        'times the score of the alignment: how well the two scans agree; 0 leaves alignments out of the probability',
        minimum=0.0,
        maximum=1e6,
        read_only=False,
    )
    score_elsewhere: float = parameter(
        0.0,
        'times the best score of an alignment with another of the nearest places by which the vehicle would be '
        'elsewhere',
        minimum=-1e6,
        maximum=0.0,
        read_only=False,
    )
    usual_uncertainty: float = parameter(
        1.0,
        'U of an ordinary scan of this sensor, which both uncertainties are divided by (offradar calibrate)',
        minimum=1e-12,
        maximum=1e12,
        read_only=False,
    )
    unrelated_distance: float = parameter(
        1.0,
        'typical distance between scans of different places; the distance of a place elsewhere counts as this if it is '
        'greater, or if the map has none',
        minimum=1e-6,
        maximum=1e6,
        read_only=False,
    )


@dataclasses.dataclass(frozen=True)
class QueryConfig:
    """Introspective querying: the paper's rule on U (Sec. III-C), or the probability that the answer is right."""

    top_k: int = parameter(5, 'places returned by a match', minimum=1, maximum=1000, read_only=False)
    gate: str = parameter(
        'probability',
        "what decides whether a query is answered: the probability that the answer is right, or the paper's rule on U "
        'alone, which is also used where the probability is not known',
        choices=('probability', 'paper'),
        read_only=False,
    )
    min_probability: float = parameter(
        0.9,
        'a query whose answer is right with a lower probability is rejected',
        minimum=0.0,
        maximum=1.0,
        read_only=False,
    )
    min_probability_unaligned: float = parameter(
        0.0,
        'the same where the scan was not aligned with the place, if it is higher than min_probability: offradar '
        'calibrate sets it, since the probability tells less then; 1 lets hardly any pass',
        minimum=0.0,
        maximum=1.0,
        read_only=False,
    )
    tolerance_m: float = parameter(
        25.0,
        'an answer is right if the place is nearer to the vehicle than this; shipped probabilities are for 25 m',
        unit='m',
        minimum=0.01,
        maximum=10000.0,
        read_only=False,
    )
    delta: float = parameter(0.5, 'Δ: thresholds span 1 − Δ to 1 + Δ', minimum=0.0, maximum=1e6, read_only=False)
    levels: int = parameter(10, 'N: number of steps between the thresholds', minimum=1, maximum=10000, read_only=False)
    level: int = parameter(
        10,
        'n: the threshold in use is (1 − Δ) + n·2Δ/N; a scan whose U is above it is rejected',
        minimum=0,
        maximum=10000,
        read_only=False,
    )
    model: str = parameter(
        '',
        'fingerprint of the model that Δ, N and n were calibrated for (offradar calibrate): embeddings of others are '
        'rejected; empty allows any',
        read_only=False,
    )
    max_distance: float = parameter(
        0.0,
        'a scan whose nearest place is farther than this in embedding space is of an unknown place; 0 turns this off',
        minimum=0.0,
        maximum=1e9,
        read_only=False,
    )
    exclude_current_session: bool = parameter(
        True, 'whether places of the running session are excluded from the search', read_only=False
    )
    position_sigma_m: float = parameter(
        10.0,
        'standard deviation of the position in match_pose where the scan could not be aligned with that of the place',
        unit='m',
        minimum=0.0,
        maximum=1000.0,
        read_only=False,
    )
    place_sigma_m: float = parameter(
        1.0,
        'standard deviation of the position of a place on each axis, by the receiver that it was mapped with; it and '
        'that of the alignment make the covariance of match_pose',
        unit='m',
        minimum=0.0,
        maximum=1000.0,
        read_only=False,
    )
    place_sigma_deg: float = parameter(
        1.0,
        'standard deviation of the heading of a place, where the map does not have it',
        unit='°',
        minimum=0.0,
        maximum=180.0,
        read_only=False,
    )
    verify: bool = parameter(
        True,
        'whether the scan is aligned with those of the nearest places, which orders them, enters the probability and '
        'gives the pose in match_pose; it needs the signatures of the places, which the map server sends, or the file '
        'of query.map_path holds',
        read_only=False,
    )
    verify_candidates: int = parameter(
        5, 'nearest places that a scan is aligned with', minimum=1, maximum=100, read_only=False
    )
    min_pose_score: float = parameter(
        0.3,
        'where the scan and that of the place agree with a lower score, match_pose has no heading and the position of '
        'the place: the pose of the alignment may be wrong altogether; 0 takes every pose',
        minimum=0.0,
        maximum=1.0,
        read_only=False,
    )
    initial_pose: bool = parameter(
        False,
        'whether the pose is published on initialpose, for Nav2 and AMCL: once after the start, after the vehicle was '
        'lost or off the map, and after ~/relocalise',
    )
    map_path: str = parameter(
        '',
        'SQLite map to read at start, and the signatures of its places: for maps that are too large for a message, or '
        'to query without a map server',
    )
    confidence: ConfidenceConfig = dataclasses.field(default_factory=ConfidenceConfig)

    def __post_init__(self) -> None:
        if self.level > self.levels:
            raise ConfigError(f'query.level: expected at most query.levels = {self.levels}, got {self.level}')


@dataclasses.dataclass(frozen=True)
class LocalisationConfig:
    """The belief over the places of the map that many scans give together (docs/localisation.md)."""

    max_places: int = parameter(
        200_000,
        'a map of more places is not localised in, because a scan would take long (about 1 ms for 10,000 places); '
        '0 turns localisation off',
        minimum=0,
        maximum=2**31 - 1,
    )
    recall: float = parameter(
        0.95,
        'probability that the place found is right, of any scan that is taken on the map',
        minimum=0.01,
        maximum=0.9999,
    )
    spacing_m: float = parameter(
        15.0,
        'two places up to this apart are neighbours on a road; set it to the distance at which the map was made, if '
        'that is larger',
        unit='m',
        minimum=0.1,
        maximum=1000.0,
    )
    max_speed_mps: float = parameter(
        25.0,
        'bounds the distance driven between two scans where odometry does not give it',
        unit='m/s',
        minimum=0.1,
        maximum=1000.0,
    )
    independent_m: float = parameter(
        10.0,
        'a scan counts in full if the vehicle has driven this since the last scan with evidence, and in proportion if '
        'it has driven less; about twice the distance over which the errors of scans are correlated',
        unit='m',
        minimum=0.01,
        maximum=1000.0,
    )
    prior_on_map: float = parameter(
        0.5, 'probability that the vehicle is on the map before its first scan', minimum=1e-6, maximum=1.0 - 1e-6
    )
    leave_per_m: float = parameter(
        5e-4, 'rate at which a road leaves the map, where mapped road goes on', unit='1/m', minimum=0.0, maximum=1.0
    )
    leave_at_end_per_m: float = parameter(
        0.02, 'is added to that rate where mapped road ends', unit='1/m', minimum=0.0, maximum=1.0
    )
    enter_per_m: float = parameter(
        1e-3, 'rate at which a vehicle that is off the map enters it, anywhere', unit='1/m', minimum=1e-9, maximum=1.0
    )
    kidnapped_per_m: float = parameter(
        1e-5,
        'rate at which the vehicle is suddenly elsewhere on the map; a larger one recovers sooner from a wrong belief',
        unit='1/m',
        minimum=1e-12,
        maximum=1.0,
    )
    decide_probability: float = parameter(
        0.99, 'on_map starts when p_here is at least this, and off_map when p_off_map is', minimum=0.5, maximum=1.0
    )
    keep_probability: float = parameter(
        0.9, 'on_map ends when p_here falls below this, and off_map when p_off_map does', minimum=0.5, maximum=1.0
    )
    relocalise_scans: int = parameter(
        8, 'number of last scans that the service relocalise answers from', minimum=1, maximum=1000
    )
    lost_after_s: float = parameter(
        10.0,
        'the state is lost when for longer than this no scan with evidence led to on_map or off_map',
        unit='s',
        minimum=0.0,
        maximum=1e6,
    )
    forget_after_s: float = parameter(
        60.0,
        'after this time without a scan the vehicle may be anywhere: all earlier scans are forgotten',
        unit='s',
        minimum=0.1,
        maximum=1e6,
    )
    restart_after_s: float = parameter(
        1.0,
        'a stamp that jumps back by more than this means that the recording starts again; a smaller jump is an error',
        unit='s',
        minimum=0.0,
        maximum=1e6,
    )

    def __post_init__(self) -> None:
        if self.keep_probability > self.decide_probability:
            raise ConfigError(
                f'localisation.keep_probability: expected at most localisation.decide_probability = '
                f'{self.decide_probability:g}, got {self.keep_probability:g}'
            )


@dataclasses.dataclass(frozen=True)
class Config:
    """All parameters of the pipeline, the command line and the nodes."""

    radar: RadarConfig = dataclasses.field(default_factory=RadarConfig)
    encoder: EncoderConfig = dataclasses.field(default_factory=EncoderConfig)
    position: PositionConfig = dataclasses.field(default_factory=PositionConfig)
    map: MapConfig = dataclasses.field(default_factory=MapConfig)
    query: QueryConfig = dataclasses.field(default_factory=QueryConfig)
    localisation: LocalisationConfig = dataclasses.field(default_factory=LocalisationConfig)


@dataclasses.dataclass(frozen=True)
class Parameter:
    """One parameter of a configuration: its dotted name, current value and bounds."""

    name: str
    value: Value
    bounds: Bounds


def parameters(config: Any, prefix: str = '') -> Iterator[Parameter]:
    """Every parameter of a configuration dataclass, in order of its fields."""
    for field in dataclasses.fields(config):
        value = getattr(config, field.name)
        if dataclasses.is_dataclass(value):
            yield from parameters(value, f'{prefix}{field.name}.')
        else:
            yield Parameter(prefix + field.name, value, field.metadata['bounds'])


def replace_values(config: ConfigT, values: Mapping[str, Any]) -> ConfigT:
    """A copy of `config` with dotted names set; ConfigError names the first unknown or invalid one."""
    removed = next((name for name in values if name in REMOVED), None)
    if removed is not None:
        raise ConfigError(f'parameter {removed} was removed: {REMOVED[removed]}; delete it from your parameters')
    return replace(config, values, 'parameter', 'offradar parameters lists all')


def read_parameters(path: str | Path) -> dict[str, Any]:
    """Dotted names and values of a parameter file, for ROS (``ros__parameters`` of any node) or plain.

    All names in the file, including parameters that only nodes have (see `is_node_parameter`). ConfigError for a file
    that cannot be read, is empty, or has two values of a parameter, for two nodes, of which a command cannot choose.
    """
    values: dict[str, Any] = {}
    named: dict[str, tuple[str, Any]] = {}
    try:
        tree = read_tree(path)
        if tree is None:
            raise ValueError('holds no parameters: expected some, or no file')
        branches = _mapping(tree)
        nodes = [key for key, branch in branches.items() if isinstance(branch, Mapping) and 'ros__parameters' in branch]
        values |= flatten({key: branch for key, branch in branches.items() if key not in nodes})
        for key in nodes:
            found = flatten(_mapping(branches[key]['ros__parameters']))
            if '*' not in str(key):
                _require_same_values(named, str(key), found)
            values |= found
    except (ConfigError, ValueError) as error:
        raise ConfigError(str(error) if str(path) in str(error) else f'{path}: {error}') from None
    return values


def _require_same_values(named: dict[str, tuple[str, Any]], node: str, found: dict[str, Any]) -> None:
    """ValueError where another node by name has another value; `named`, such nodes and values, is extended."""
    for name, value in found.items():
        other, other_value = named.setdefault(name, (node, value))
        if other_value != value and not is_node_parameter(name):
            raise ValueError(
                f'{name} is {other_value!r} for {other} and {value!r} for {node}: expected a file for each'
            )


def _mapping(tree: Any) -> Mapping[str, Any]:
    if not isinstance(tree, (Mapping, type(None))):
        raise ValueError(f'expected a mapping of parameters, got {type(tree).__name__}')
    return tree or {}


def is_node_parameter(name: str) -> bool:
    """Whether this is a parameter of nodes (ROS's own, or declared by ours) that is not part of the configuration."""
    return name in NODE_PARAMETERS or name.startswith(NODE_PARAMETER_PREFIX)


def load_config(path: str | Path | None = None, overrides: Mapping[str, Any] | None = None) -> Config:
    """Defaults, then the YAML file, then `overrides` (dotted names).

    Parameters of nodes in the same file (`is_node_parameter`) are ignored.
    """
    config = Config()
    if path is not None:
        values = read_parameters(path)
        config = replace_values(config, {name: value for name, value in values.items() if not is_node_parameter(name)})
    return replace_values(config, overrides or {})


def write_parameters(
    path: str | Path, values: Mapping[str, Value], comment: str = '', with_digest: bool = False
) -> None:
    """Write dotted names as a ROS parameter file for every node (``/**``), whole or not at all.

    `with_digest`: for a file that a program wrote and nobody need edit: `read_parameters` then refuses other values.
    ConfigError if it cannot be written: then a file at `path` is as it was.
    """
    tree: dict[str, Any] = {}
    for name, value in values.items():
        *groups, leaf = name.split('.')
        branch = tree
        for group in groups:
            branch = branch.setdefault(group, {})
        branch[leaf] = value
    text = to_yaml({'/**': {'ros__parameters': tree}})
    header = ''.join(f'# {line}\n' for line in comment.splitlines())
    if with_digest:
        header += digest_line(parse_yaml(text))
    try:
        write_whole_file(path, (header + text).encode())
    except OSError as error:
        raise ConfigError(f'{path}: the parameter file cannot be written ({error.strerror})') from error
