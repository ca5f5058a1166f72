"""Weather against sums over drops and flakes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from offradar_ros.lab.simulation.weather import CLEAR, Weather

Array = NDArray[np.float64]

WAVELENGTH_MM = 299.792458 / 77.0
WATER = complex(3.356, 1.908)
"""Refractive index of water at 77 GHz and 10 °C, from the double Debye permittivity of Recommendation ITU-R P.840."""


def mie(size: float, index: complex) -> tuple[float, float]:
    """Efficiencies of extinction and of backscatter of a sphere of `size` = π diameter / wavelength."""
    terms = int(size + 4 * size ** (1 / 3) + 2)
    logarithmic = np.zeros(max(terms, int(abs(index * size))) + 17, complex)
    for n in range(len(logarithmic) - 1, 0, -1):
        logarithmic[n - 1] = n / (index * size) - 1 / (logarithmic[n] + n / (index * size))
    psi, psi_before = math.sin(size), math.cos(size)
    chi, chi_before = math.cos(size), -math.sin(size)
    xi, extinction, backward = complex(psi, -chi), 0.0, 0j
    for n in range(1, terms + 1):
        psi_next, chi_next = ((2 * n - 1) * now / size - old for now, old in ((psi, psi_before), (chi, chi_before)))
        xi_next = complex(psi_next, -chi_next)
        a, b = (
            ((k + n / size) * psi_next - psi) / ((k + n / size) * xi_next - xi)
            for k in (logarithmic[n] / index, logarithmic[n] * index)
        )
        extinction += (2 * n + 1) * (a + b).real
        backward += (2 * n + 1) * (-1) ** n * (a - b)
        psi_before, psi, chi_before, chi, xi = psi, psi_next, chi, chi_next, xi_next
    return 2 / size**2 * extinction, abs(backward) ** 2 / size**2


def summed(numbers: Array, diameters_mm: Array, index: complex) -> tuple[float, float]:
    """Attenuation, dB/km, and backscatter, m²/m³, of `numbers` of drops per cubic metre and millimetre of diameter."""
    step = diameters_mm[1] - diameters_mm[0]
    extinction = backward = 0.0
    for number, diameter in zip(numbers, diameters_mm, strict=True):
        efficiency, back = mie(math.pi * diameter / WAVELENGTH_MM, index)
        area_m2 = math.pi / 4 * diameter**2 * 1e-6
        extinction += number * step * area_m2 * efficiency
        backward += number * step * area_m2 * back
    return 10.0 * math.log10(math.e) * 1000.0 * extinction, backward


def eta_of(weather: Weather) -> float:
    """Backscatter, m²/m³, from that of a cell at 10 m, its volume and the 45 dB of a square metre."""
    volume_m3 = math.pi / 4 * 0.0314 * 0.06 * 100.0 * 0.175
    at_10_m = weather.backscatter(np.array([10.0]))[0] / weather.transmission(np.array([10.0]))[0]
    return float(at_10_m / volume_m3 / 10**4.5)


@pytest.mark.parametrize('rain_mm_h', [2.0, 10.0, 40.0])
def test_rain_against_marshall_and_palmers_drops(rain_mm_h: float) -> None:
    diameters = np.arange(0.05, 7.0, 0.1)
    decibels, eta = summed(8000 * np.exp(-4.1 * rain_mm_h**-0.21 * diameters), diameters, WATER)
    weather = Weather(rain_mm_h=rain_mm_h)
    assert 1000 * weather.attenuation_db_m() == pytest.approx(decibels, rel=0.3)
    assert eta_of(weather) == pytest.approx(eta, rel=0.15)


@pytest.mark.parametrize('snow_mm_h', [0.5, 2.0])
def test_snow_against_gunn_and_marshalls_flakes(snow_mm_h: float) -> None:
    """Flakes of 0.2 g/cm³: ice in air by Maxwell Garnett's rule."""
    share = 0.2 / 0.917
    ice = share * (3.17 + 0.005j - 1) / (3.17 + 0.005j + 2)
    index = np.sqrt((1 + 2 * ice) / (1 - ice))
    melted = np.arange(0.05, 7.0, 0.1)
    numbers = 3800 * snow_mm_h**-0.87 * np.exp(-2.55 * snow_mm_h**-0.48 * melted)
    stretch = 0.2 ** (-1 / 3)
    decibels, eta = summed(numbers / stretch, melted * stretch, index)
    weather = Weather(snow_mm_h=snow_mm_h)
    assert 1000 * weather.attenuation_db_m() == pytest.approx(decibels, rel=0.2)
    assert eta_of(weather) == pytest.approx(eta, rel=0.2)


def test_attenuation_is_two_way() -> None:
    weather = Weather(rain_mm_h=25.0)
    ranges = np.array([0.0, 50.0, 100.0])
    np.testing.assert_allclose(-10 * np.log10(weather.transmission(ranges)), 2 * ranges * weather.attenuation_db_m())


def test_clear_air_changes_nothing_and_worse_weather_attenuates_more() -> None:
    ranges = np.linspace(1.0, 200.0, 50)
    assert np.all(CLEAR.transmission(ranges) == 1.0) and np.all(CLEAR.backscatter(ranges) == 0.0)
    for field, values in (('rain_mm_h', (1, 5, 50)), ('snow_mm_h', (0.5, 2, 5)), ('fog_visibility_m', (500, 100, 50))):
        transmissions = [Weather(**{field: value}).transmission(ranges)[-1] for value in values]
        assert 1.0 > transmissions[0] > transmissions[1] > transmissions[2]
