"""The Fast DDS profile is readable, has room for scans, is installed, and a user's profile takes precedence."""

from __future__ import annotations

import runpy
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest
import setuptools
from launch_stand_in import of_kind, started

from offradar_ros.lab.live.node_processes import isolated_environment
from offradar_ros.ros import dds_profile
from offradar_ros.ros.dds_profile import VARIABLE, with_profile
from offradar_ros.shipped import installed_file

PROJECT = Path(__file__).resolve().parents[2]
PROFILE = PROJECT / 'params' / 'fastdds.xml'
NAMESPACE = {'d': 'http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles'}
SCAN_BYTES = 400 * 7536


def test_the_profile_has_shared_memory_for_scans_and_udp_for_other_machines() -> None:
    root = ET.parse(PROFILE).getroot()
    described = {
        one.findtext('d:transport_id', None, NAMESPACE): one
        for one in root.iterfind('.//d:transport_descriptor', NAMESPACE)
    }
    (participant,) = root.iterfind('.//d:participant', NAMESPACE)
    used = [one.text for one in participant.iterfind('.//d:userTransports/d:transport_id', NAMESPACE)]
    assert participant.get('is_default_profile') == 'true'
    assert [described[name].findtext('d:type', None, NAMESPACE) for name in used] == ['SHM', 'UDPv4']
    segment = described[used[0]].findtext('d:segment_size', '', NAMESPACE)
    assert int(segment) > 8 * SCAN_BYTES


def test_a_users_profile_is_kept() -> None:
    assert with_profile({'A': 'b'}) == {'A': 'b', VARIABLE: str(PROFILE)}
    assert with_profile({VARIABLE: '/my/own.xml'}) == {VARIABLE: '/my/own.xml'}
    assert with_profile({VARIABLE: ''}) == {VARIABLE: str(PROFILE)}


def test_nodes_that_are_started_have_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    assert isolated_environment(1)[VARIABLE] == str(PROFILE)
    monkeypatch.setenv(VARIABLE, '/my/own.xml')
    assert isolated_environment(1)[VARIABLE] == '/my/own.xml'


def test_where_it_is_missing_the_nodes_start_without_it(monkeypatch: pytest.MonkeyPatch) -> None:
    assert installed_file('fastdds.xml') == PROFILE
    assert installed_file('nothing.xml') is None
    monkeypatch.setattr(dds_profile, 'installed_file', lambda name: None)
    assert with_profile({'A': 'b'}) == {'A': 'b'}


def test_fast_dds_accepts_it_without_a_message_and_has_the_memory(domain_id: int) -> None:
    """The process maps shared memory, and does not open the port on which other machines announce themselves."""
    program = (
        'import re, rclpy\n'
        'rclpy.init()\n'
        'node = rclpy.create_node("large")\n'
        'ranges = re.findall(r"(\\w+)-(\\w+) rw-s .*/fastrtps_", open("/proc/self/maps").read())\n'
        'print(max(int(end, 16) - int(start, 16) for start, end in ranges))\n'
        'ports = [line.split()[1].rpartition(":")[2] for line in list(open("/proc/net/udp"))[1:]]\n'
        f'print(sum(int(port, 16) == 7400 + 250 * {domain_id} for port in ports))\n'
    )
    environment = isolated_environment(domain_id)
    done = subprocess.run([sys.executable, '-c', program], env=environment, capture_output=True, text=True, check=True)
    assert 'XML' not in done.stderr
    mapped, listening = map(int, done.stdout.split())
    assert mapped > 32 * 2**20
    assert listening == 0


def test_it_is_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    given: dict[str, Any] = {}
    monkeypatch.chdir(PROJECT)
    monkeypatch.setattr(setuptools, 'setup', given.update)
    runpy.run_path('setup.py')
    installed = dict(given['data_files'])
    assert 'params/fastdds.xml' in installed['share/offradar_ros/params']
    assert 'params/offradar.yaml' in installed['share/offradar_ros/params']


def test_the_launch_file_gives_it_to_its_nodes_alone() -> None:
    nodes = started()
    assert len(nodes) == 3
    for node in nodes:
        ((name, value),) = node.options['additional_env'].items()
        assert (name, value.arguments) == (VARIABLE, ('dds_profile',))


@pytest.mark.parametrize('named', [None, '', '/my/own.xml'])
def test_the_launch_file_keeps_a_users_profile(monkeypatch: pytest.MonkeyPatch, named: str | None) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    if named is not None:
        monkeypatch.setenv(VARIABLE, named)
    (declared,) = (action for action in of_kind('DeclareLaunchArgument') if action.arguments[:1] == ('dds_profile',))
    default = declared.options['default_value']
    if named:
        assert default == named
    else:
        assert default.arguments[0][1:] == ['params', 'fastdds.xml']
