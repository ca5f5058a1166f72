"""Drives that need no simulation."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from street_evaluation import SMALL_PROTOCOL, StreetEvaluation, evaluate_street, measure_street, street_drive

from offradar_ros.lab.evaluation.embedding_cache import EmbeddedDrive
from offradar_ros.lab.evaluation.protocol import Protocol
from offradar_ros.lab.evaluation.runner import Measured


@pytest.fixture(scope='session')
def embedded_street() -> Callable[..., EmbeddedDrive]:
    return street_drive


@pytest.fixture(scope='session')
def measured_street() -> Callable[..., Measured]:
    return measure_street


@pytest.fixture(scope='session')
def small_protocol() -> Protocol:
    return SMALL_PROTOCOL


@pytest.fixture(scope='session')
def street_evaluation() -> StreetEvaluation:
    return evaluate_street()
