"""The simulated drives of a protocol: through its cities, and along its streets if their folder is given."""

from __future__ import annotations

from pathlib import Path

from offradar_ros.lab.evaluation.protocol import Group, Lane, Protocol, RealStreets, Validation
from offradar_ros.lab.evaluation.simulated_drives import simulated_drives


def test_streets_are_left_out_without_their_folder(tmp_path: Path) -> None:
    street = RealStreets('toy', 'm.yaml', ('a.tum', 'b.tum'), 7)
    group = Group('g', 'G', 'drawn', cities=(3, 4), streets=(street,))
    protocol = Protocol('p', 'P', (group,), (Lane(), Lane(1.0)), Validation((9,), scans=7))
    without = list(simulated_drives(protocol, None))
    assert [d.source.world for d in without] == ['city_3'] * 2 + ['city_4'] * 2 + ['city_9']
    assert [d.source.name for d in without[:3]] == ['city_3_1', 'city_3_2', 'city_4_1']
    assert [d.source.world for d in simulated_drives(protocol, tmp_path)][4:6] == ['toy', 'toy']
    last = without[-1]
    assert (last.group, last.source.scans, last.source.plan.degraded) == ('validation', 7, 0.0)
    assert [(d.group, d.index) for d in without[:2]] == [('g', 0), ('g', 1)]
    assert [d.source.plan.foliage for d in simulated_drives(protocol, tmp_path)][:6] == [1.0, 0.0] * 3
