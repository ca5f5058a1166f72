"""Campaigns never meet the nodes of tests or benchmarks that run meanwhile."""

from __future__ import annotations

import inspect
import itertools

import pytest
import ros_domain

pytest.importorskip('rclpy')

from faults import free_domains
from pipeline import DOMAIN_ID

from offradar_ros.lab.cli.demo import demo


def test_a_domain_is_taken_once() -> None:
    with free_domains.free_domains(2) as first, free_domains.free_domains(3) as second:
        assert len({*first, *second}) == 5
        assert {*first, *second} <= {*free_domains.DOMAINS}


def test_tests_campaigns_benchmarks_and_the_demonstration_have_domains_of_their_own() -> None:
    tests = set(itertools.chain.from_iterable(ros_domain.domains_of(worker) for worker in range(9)))
    assert tests == {*ros_domain.DOMAINS}
    assert all(len(ros_domain.domains_of(worker)) == 20 for worker in range(9))
    assert not tests & {*free_domains.DOMAINS}
    others = {DOMAIN_ID, inspect.signature(demo).parameters['domain_id'].default}
    assert len(others) == 2
    assert not others & (tests | {*free_domains.DOMAINS})
