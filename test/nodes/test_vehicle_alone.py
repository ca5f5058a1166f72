"""The nodes on a vehicle that has what a node needs and nothing else."""

from __future__ import annotations

import array
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from absent_packages import environment_without
from live_nodes import WAIT_S, Observer, wait_until
from sensor_msgs.msg import Image, NavSatFix
from std_msgs.msg import Header
from std_srvs.srv import Trigger

from offradar_ros.config import EncoderConfig
from offradar_ros.lab.live.node_processes import Stack
from offradar_ros.ros import qos
from offradar_ros.ros.stamps import header
from offradar_ros.types import Match

SECOND = 10**9
ABSENT = ('rosbags', 'torch', 'matplotlib', 'typer', 'rich')


@pytest.fixture
def bare(tmp_path: Path) -> dict[str, str]:
    """Environment of a Python that finds none of `ABSENT`."""
    return environment_without(ABSENT, tmp_path / 'bare')


def test_nothing_of_it_is_found(bare: dict[str, str]) -> None:
    code = f'from importlib.util import find_spec; print([name for name in {(*ABSENT, "numpy")} if find_spec(name)])'
    ran = subprocess.run(
        [sys.executable, '-c', code], env=os.environ | bare, capture_output=True, text=True, timeout=WAIT_S, check=True
    )
    assert ran.stdout == "['numpy']\n"


@pytest.mark.parametrize(
    'encoder', [{'encoder.name': 'ring_key'}, {'encoder.name': EncoderConfig.name}], ids=['ring key', 'default']
)
def test_the_nodes_map_a_scan_and_find_it_again(
    observer: Observer,
    stack: Callable[..., Stack],
    street: Callable[..., Any],
    tmp_path: Path,
    bare: dict[str, str],
    encoder: dict[str, str],
) -> None:
    scan = street(count=1).scan(0)
    outcomes, handled = observer.collect_outcomes(), observer.collect(Header, 'map_server/handled', qos.UPDATES)

    def wait_for_answers(count: int) -> None:
        wait_until(lambda: len(outcomes) == len(handled) == count)

    parameters = {'map.path': str(tmp_path / 'map.db'), 'map.start_session': True, 'query.delta': 100.0}
    with stack(parameters | encoder, environment=bare) as nodes:
        nodes.wait_until_ready(WAIT_S)
        # The map server and the query node.
        observer.wait_until_connected(**{'embedding': 2, 'map_server/handled': 1})
        send = observer.publisher(Image, 'radar_data/b_scan_image', qos.SCANS)
        fix = observer.publisher(NavSatFix, 'gps/fix', qos.POSITIONS)
        for second in (10, 11):
            fix(NavSatFix(header=header(second * SECOND, 'gps'), latitude=51.75, longitude=-1.25))
        for second in (10, 20):
            height, width = scan.power.shape
            image = Image(header=header(second * SECOND, 'radar'), height=height, width=width, step=width)
            image.encoding, image.data = '8UC1', array.array('B', scan.power.tobytes())
            send(image)
            wait_for_answers(second // 10)
            if second == 10:
                ended = observer.call(Trigger, 'map_server/end_session', Trigger.Request())
                assert '1 inserted' in ended.message, ended.message
                wait_until(lambda: 'map of 1 places' in nodes.nodes['query_node'].log.read_text())
        for node in nodes.nodes.values():
            node.process.send_signal(signal.SIGINT)
        assert [node.wait(WAIT_S) for node in nodes.nodes.values()] == [0, 0, 0]
        assert all('Traceback' not in node.log.read_text() for node in nodes.nodes.values())
    first, second_ = outcomes
    assert not isinstance(first, Match)
    assert first.reason == 'map_empty'
    assert isinstance(second_, Match)
    assert second_.candidates[0].distance == pytest.approx(0.0, abs=1e-3)
