"""Cities from seeds: `make_city(CityPlan(seed=1))`."""

from offradar_ros.lab.simulation.city.make import make_city
from offradar_ros.lab.simulation.city.plan import CityPlan, District

__all__ = ['CityPlan', 'District', 'make_city']
