"""Which topic of a bag holds the polar scans: told by content where it can be, asked for where not."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recorded_topics import Recorded, compressed_scans, fixes, images, jpeg, record, scans

from offradar_ros.config import RadarConfig
from offradar_ros.errors import DataError
from offradar_ros.recordings.bags.reader import Bag
from offradar_ros.recordings.bags.scan_topic import scan_topic
from offradar_ros.recordings.bags.sequence import BagSequence
from offradar_ros.recordings.bags.topics import COMPRESSED_TYPE, IMAGE_TYPE, ChosenTopics
from offradar_ros.types import PolarScan

Found = Callable[..., str]


@pytest.fixture
def drive(street: Callable[..., Any]) -> Any:
    return street(count=3)


@pytest.fixture
def found(tmp_path: Path) -> Found:
    """The topic that is chosen in a bag of some streams."""

    def choose(*streams: Any, wanted: str = '', radar: RadarConfig | None = None, **options: Any) -> str:
        with Bag(record(tmp_path / 'bag', *streams, **options)) as bag:
            return scan_topic(bag, radar, wanted)

    return choose


def as_power(drive: Any, rows: int, bins: int) -> Any:
    """The drive as a radar of another size sees it."""

    class Resized:
        stamps_ns = drive.stamps_ns

        def __len__(self) -> int:
            return len(drive)

        def scan(self, index: int) -> PolarScan:
            power = np.resize(drive.scan(index).power, (rows, bins))
            return PolarScan(int(drive.stamps_ns[index]), power, np.arange(rows) / rows * 2 * np.pi, 0.1)

    return Resized()


def test_the_only_images_are_the_scans_under_any_name(drive: Any, found: Found) -> None:
    assert found(scans(drive, '/roof/sensor_7/pictures'), fixes(drive)) == '/roof/sensor_7/pictures'


def test_compressed_scans_are_found_and_read(drive: Any, tmp_path: Path) -> None:
    bag = BagSequence(record(tmp_path / 'bag', compressed_scans(drive), fixes(drive)))
    for index in range(3):
        np.testing.assert_array_equal(bag.scan(index).power, drive.scan(index).power)
    assert bag.trajectory is not None


@pytest.mark.parametrize('camera', [('rgb8', 48, 64), ('mono8', 480, 640), ('mono8', 1080, 1920)])
@pytest.mark.parametrize('radar', [scans, compressed_scans])
def test_a_camera_is_not_taken_for_the_radar(
    drive: Any, found: Found, camera: tuple[str, int, int], radar: Callable[..., Any]
) -> None:
    assert found(images(drive, '/a_camera/image', *camera), radar(drive, '/navtech/scan')) == '/navtech/scan'


def test_a_cartesian_image_of_the_radar_is_not_taken_for_its_scans(drive: Any, found: Found) -> None:
    streams = images(drive, '/Navtech/Cartesian', 'mono8', 1152, 1152), scans(drive, '/Navtech/raw')
    assert found(*streams) == '/Navtech/raw'


def test_the_usual_name_decides_where_the_size_does_not(drive: Any, found: Found) -> None:
    """A radar of 2856 bins, which no profile has, beside a gray camera of 400 rows."""
    odd = as_power(drive, 400, 2856)
    camera = list(images(drive, '/front/image', 'mono8', 400, 640))
    assert found(camera, scans(odd)) == '/radar_data/b_scan_image'


def test_the_usual_name_decides_between_two_radars(drive: Any, found: Found) -> None:
    assert found(scans(drive, '/rear/scan'), scans(drive)) == '/radar_data/b_scan_image'


def test_where_nothing_decides_all_are_listed(drive: Any, found: Found, tmp_path: Path) -> None:
    odd = as_power(drive, 400, 2856)
    camera = list(images(drive, '/front/image', 'mono8', 400, 640))
    with pytest.raises(DataError) as refused:
        found(camera, scans(odd, '/roof/scan'))
    text = str(refused.value)
    assert text.startswith(f'{tmp_path / "bag"}: several topics may be the scans, choose one with --topic: ')
    assert f'/front/image ({IMAGE_TYPE}, mono8 400 × 640, 3 messages)' in text
    assert f'/roof/scan ({IMAGE_TYPE}, 8UC1 400 × 2856, 3 messages)' in text


def test_a_configured_radar_is_told_by_its_number_of_azimuths(drive: Any, found: Found) -> None:
    odd = as_power(drive, 400, 2856)
    camera = images(drive, '/front/image', 'mono8', 480, 640)
    assert found(camera, scans(odd, '/roof/scan'), radar=RadarConfig(range_resolution_m=0.175)) == '/roof/scan'


def test_a_camera_with_as_many_rows_as_a_configured_radar_is_a_choice(drive: Any, found: Found) -> None:
    """With a bin size, every gray image can be read."""
    odd = as_power(drive, 400, 2856)
    camera = list(images(drive, '/front/image', 'mono8', 400, 640))
    for picture in camera:
        picture.message.data[::2] = 70
    with pytest.raises(DataError, match='several topics'):
        found(camera, scans(odd, '/roof/scan'), radar=RadarConfig(range_resolution_m=0.175))


def test_two_cars_are_a_choice_and_the_option_makes_it(drive: Any, found: Found, tmp_path: Path) -> None:
    cars = [list(scans(drive, f'/car{n}/radar_data/b_scan_image')) for n in (1, 2)]
    with pytest.raises(DataError, match=r'choose one with --topic: /car1/.*, /car2/'):
        found(*cars)
    for wanted in ('/car2/radar_data/b_scan_image', 'car2/radar_data/b_scan_image'):
        with Bag(tmp_path / 'bag') as bag:
            assert scan_topic(bag, wanted=wanted) == '/car2/radar_data/b_scan_image'
    assert len(BagSequence(tmp_path / 'bag', topics=ChosenTopics('car1/radar_data/b_scan_image'))) == 3


def test_of_a_raw_and_a_compressed_copy_the_raw_one_is_read(drive: Any, found: Found) -> None:
    both = scans(drive, '/navtech/scan'), compressed_scans(drive, '/navtech/scan/compressed')
    assert found(*both) == '/navtech/scan'


def test_an_empty_topic_does_not_count_beside_one_with_scans(drive: Any, found: Found) -> None:
    streams = compressed_scans(drive)
    name = '/radar_data/b_scan_image'
    assert found(streams, empty=[(name, IMAGE_TYPE)]) == f'{name}/compressed'


@pytest.mark.parametrize('msgtype', [IMAGE_TYPE, COMPRESSED_TYPE])
def test_a_topic_without_messages_is_no_scans(drive: Any, tmp_path: Path, msgtype: str) -> None:
    bag = record(tmp_path / 'bag', fixes(drive), empty=[('/scan', msgtype)])
    with pytest.raises(DataError, match='no scans: topic /scan holds no messages'):
        BagSequence(bag)


def test_a_bag_without_images_says_what_it_has(drive: Any, found: Found) -> None:
    with pytest.raises(DataError, match=r'no scans: expected a topic of .*found /gps/fix \(sensor_msgs/msg/NavSatFix'):
        found(fixes(drive))


@pytest.mark.parametrize(
    ('streams', 'reason'),
    [
        (lambda drive: images(drive, '/camera/image', 'rgb8', 48, 64), "encoding 'rgb8'"),
        (lambda drive: compressed_scans(drive, encode=jpeg), 'JPEG'),
    ],
)
def test_images_that_cannot_be_scans_are_not_read_as_such(
    drive: Any, found: Found, streams: Callable[[Any], Any], reason: str
) -> None:
    with pytest.raises(DataError, match=f'no scans: expected polar images of 8-bit gray, found .*{reason}'):
        found(streams(drive))


@pytest.mark.parametrize(
    ('wanted', 'expected'),
    [
        ('/lidar/scan', r'--topic /lidar/scan is not in it: expected one of /camera/image .*, /navtech/scan '),
        ('/gps/fix', r'--topic /gps/fix is sensor_msgs/msg/NavSatFix: expected one of '),
        ('/camera/image', r"--topic /camera/image .* holds no polar scans: .*'rgb8'"),
        ('/silent', r'no scans: topic /silent holds no messages'),
    ],
)
def test_a_wrong_choice_is_named(drive: Any, found: Found, wanted: str, expected: str) -> None:
    streams = images(drive, '/camera/image', 'rgb8', 48, 64), scans(drive, '/navtech/scan'), fixes(drive)
    with pytest.raises(DataError, match=expected):
        found(*streams, wanted=wanted, empty=[('/silent', IMAGE_TYPE)])


def test_one_damaged_message_does_not_hide_the_scans(drive: Any, found: Found) -> None:
    rows = list(scans(drive, '/navtech/scan'))
    rows[0] = Recorded(rows[0].log_ns, '/navtech/scan', IMAGE_TYPE, b'\0\1\0\0ab')
    assert found(rows, images(drive, '/camera/image', 'mono8', 480, 640)) == '/navtech/scan'
