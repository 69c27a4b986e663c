"""The gate for the time of mapping: the default rules beside the thesis' own."""

import pytest

from benchmarks import pipeline


@pytest.mark.parametrize(("most", "code"), [(0.0, 1), (1000.0, 0)])
def test_the_gate_fails_where_the_default_rules_take_too_long(
    shared, monkeypatch, capsys, most, code
):
    monkeypatch.setattr(pipeline, "MAX_RATIO", most)
    room = str(shared("data/rgbd/icl_livingroom"))
    assert pipeline.main([room, "--rules", "--frames", "1", "--rounds", "1"]) == code
    rows = capsys.readouterr().out.splitlines()
    assert "| icl_livingroom | 1 |" in rows[2]
    assert ("passed" in rows[-1]) == (code == 0)
