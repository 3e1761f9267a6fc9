"""The tables of docs/scaling.md are what the code says, and the simulation is as it was kept."""

from __future__ import annotations

from pathlib import Path

import pytest

from house.syntax import ROOT
from rhytid.errors import InputError
from rhytid_lab.scaling.capacity import Shared, full
from rhytid_lab.scaling.examples import STUDIO, measured_runs, one_core, paper_device, studio_shared
from rhytid_lab.scaling.fleet import Fleet, simulate
from rhytid_lab.scaling.page import outcomes, rewritten
from rhytid_lab.scaling.plot import plot

PAGE = ROOT / "docs" / "scaling.md"


def test_the_tables_are_those_of_the_code() -> None:
    text = PAGE.read_text(encoding="utf-8")

    assert rewritten(text) == text, "run `python -m rhytid_lab.scaling page docs/scaling.md`"
    assert text.count("<!-- table: ") == text.count("<!-- end -->") == 10


def test_a_table_that_is_unknown_is_refused() -> None:
    with pytest.raises(InputError, match="no table 'nothing'"):
        rewritten("<!-- table: nothing -->\n<!-- end -->")
    with pytest.raises(InputError, match="no place"):
        rewritten("text")


@pytest.mark.slow
def test_the_simulation_gives_what_was_kept() -> None:
    fleet = Fleet()
    requests = fleet.requests(200_000)
    policies = {policy.name: policy for policy in fleet.policies()}
    for kept in outcomes():
        if kept.policy in ("id mod N", "rendezvous, hot heads replicated"):  # the others take long
            assert simulate(fleet, policies[kept.policy], requests) == kept


def test_runs_cover_both_methods_and_worker_counts() -> None:
    runs = {(run.size, run.method, run.workers) for run in measured_runs()}

    assert runs == {(s, m, w) for s in (1024, 2048) for m in ("redraw", "binned") for w in (1, 2)}


def test_the_gpu_draws_in_the_times_of_the_paper() -> None:
    model = paper_device()

    assert model.draw(STUDIO, "redraw") == pytest.approx(2.4 / 16)
    assert model.draw(STUDIO, "binned") == pytest.approx(0.05 / 16)
    assert model.constants.write == one_core().constants.write


def test_what_gives_out_first_comes_first() -> None:
    wide, narrow = Shared("wide", "B/s", 1.0, 100.0), Shared("narrow", "B/s", 1.0, 10.0)

    assert full([wide, narrow], 10) == []
    assert full([wide, narrow], 11) == [narrow]
    assert full([wide, narrow], 101) == [narrow, wide]
    assert Shared("unused", "B/s", 0.0, 1.0).used(1000) == 0.0


def test_assets_that_are_missed_are_read() -> None:
    few, many = (studio_shared(misses)[-1].per_device for misses in (0.001, 0.01))

    assert many == pytest.approx(10 * few)


@pytest.mark.slow
def test_the_plot_has_a_line_for_each_policy(tmp_path: Path) -> None:
    figure = plot({held: outcomes() for held in (10, 20)})

    assert [len(axes.lines) for axes in figure.axes] == [5, 5]
    figure.savefig(tmp_path / "placement.png")
    assert (tmp_path / "placement.png").stat().st_size > 1000
