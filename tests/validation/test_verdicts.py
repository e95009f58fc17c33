"""A few random mechanisms by every method: validation/robustness/verdicts.py and bounds.py."""

import bounds
import pytest
import verdicts


@pytest.mark.slow
def test_random_mechanisms_pass_with_consistent_verdicts():
    result = verdicts.study(range(4), seed=3)
    assert result.faults == {}
    assert result.tried["validated"] == 4
    assert result.tried["0.1 % long, pose"] >= 2
    assert result.tried["pose, close"] == result.tried["step, close"] >= 1


@pytest.mark.slow
def test_errors_use_a_significant_fraction_of_their_tolerances(monkeypatch):
    # 1,000 steps a revolution are too few for the dynamics of these linkages without a tolerance
    monkeypatch.setattr(bounds, "prescribed_checks", lambda solver: [])
    result = bounds.tolerance_fractions(4, seed=3)
    worst = {key: max(used)[0] for key, used in result.items()}
    for (route, kind), used in worst.items():
        assert used <= 1.0, (route, kind)
    # a few mechanisms use less of a tolerance than the worst of many, which use a hundredth or more
    for route in ("formula", "pose", "step"):
        for kind in ("velocity", "acceleration", *(() if route == "formula" else ("loop",))):
            assert worst[route, kind] > 1e-4, (route, kind)
    assert worst["pose", "position"] > 1e-3
    assert worst["step", "position"] > 1e-3
