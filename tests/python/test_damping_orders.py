# SPDX-License-Identifier: BSD-3-Clause
"""Every scheme with every kind of damping: right with its measured order, or refused with the reason on the page."""

import json
import sys
from pathlib import Path

import pytest
import symsde as ss

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "docs"))
import damping_orders

KNOWN = json.loads(damping_orders.TARGET.read_text(encoding="utf-8"))
REFUSALS = 50  #: pairs of scheme and kind that are refused


def test_all_pairs_are_on_the_page():
    """No scheme and no kind is left out; how many pairs are refused is known."""
    assert list(KNOWN) == list(ss.schemes.names())
    assert all(list(kinds) == list(damping_orders.KINDS) for kinds in KNOWN.values())
    refused = sum(isinstance(kind["additive"], str) for kinds in KNOWN.values() for kind in kinds.values())
    assert refused == REFUSALS


@pytest.mark.parametrize("scheme", KNOWN)
def test_every_pair_is_right_or_refused(scheme):
    """Slopes equal the recorded slopes, and not below the order of the closed system."""
    orders = ss.schemes.get(scheme).info.orders
    for kind, of_kind in KNOWN[scheme].items():
        for noises, known in of_kind.items():
            found = damping_orders.measured(scheme, kind, noises)
            if isinstance(known, str):
                assert found == known and known, (kind, noises)
            else:
                order = orders["additive" if noises == "additive" else "commutative"].value
                assert found == pytest.approx(known, abs=0.02), (kind, noises)
                if kind == "gamma_i(q, t)":  # a drift between two decays has order two
                    order = min(order, 2)
                assert found > order - 0.2, (kind, noises)
