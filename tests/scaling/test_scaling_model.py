"""The cost model: constants out of figures that are known, and the formula by hand."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from rhytid.errors import InputError
from rhytid_lab.scaling.__main__ import main
from rhytid_lab.scaling.check import check
from rhytid_lab.scaling.constants import Constants
from rhytid_lab.scaling.figures import Frame, Run, read_frame, read_runs
from rhytid_lab.scaling.model import Head, Model

KNOWN = Constants(
    "device", (2e-9, 3e-7), (4e-8, 5e-7), 1e-9, 0.01, 0.02, 6e-8, (2.0, 0.0), 3.5, 60.0
)
HEAD = Head(1024, 100_000)
TEXELS = 1024**2


def frame(size: int, wrinkles: int) -> Frame:
    head, model = Head(size, wrinkles), Model(KNOWN)
    seconds = {
        "redraw": model.draw(head, "redraw"),
        "binned": model.draw(head, "binned"),
        "precompute": 4e-8 * head.texels + 5e-7 * wrinkles,
    }
    return Frame("device", size, wrinkles, seconds, {name: s / 2 for name, s in seconds.items()})


def run(size: int, frames: int, method: str = "redraw", workers: int = 1) -> Run:
    head, model = Head(size, 100_000), Model(KNOWN)
    each = {
        "stretch": 0.01,
        method: model.draw(head, method) + 0.02,
        "write": 6e-8 * head.texels,
    }
    wall = model.bake(head, method, frames, workers)
    nbytes = round(3.5 * frames * head.texels)
    steps = {name: frames * seconds for name, seconds in each.items()}
    return Run(size, 100_000, method, workers, frames, wall, wall * workers, nbytes, steps)


def test_constants_are_found_again() -> None:
    found = Constants.of([frame(1024, 100_000), frame(1024, 400_000)], [run(1024, 8)])

    assert found.redraw == pytest.approx(KNOWN.redraw)
    assert found.precompute == pytest.approx(KNOWN.precompute)
    for name in ("binned", "put", "beyond", "write", "file_bytes"):
        assert getattr(found, name) == pytest.approx(getattr(KNOWN, name)), name
    assert found.start[0] == pytest.approx(2.0)


def test_one_density_goes_by_texels() -> None:
    found = Constants.of([frame(1024, 100_000)], [run(1024, 8)])

    assert found.redraw == pytest.approx((Model(KNOWN).draw(HEAD, "redraw") / TEXELS, 0.0))


def test_on_a_shared_machine_processor_time_counts() -> None:
    found = Constants.of([frame(1024, 100_000)], [run(1024, 8)], shared=True)

    assert found.binned == pytest.approx(KNOWN.binned / 2)


def test_a_prediction_of_what_the_formula_made_is_exact() -> None:
    for found in check(Model(KNOWN), [run(2048, 60), run(2048, 60, workers=2)]):
        assert found.error == pytest.approx(0.0)
        assert found.wall_error == pytest.approx(0.0)


def test_the_formula_by_hand() -> None:
    model = Model(KNOWN)

    drawn = 2e-9 * TEXELS + 3e-7 * 100_000
    assert model.frame(HEAD, "redraw") == pytest.approx(0.01 + drawn + 0.02 + 6e-8 * TEXELS)
    assert model.once(HEAD, "redraw") == pytest.approx(2.0)
    assert model.once(HEAD, "binned") == pytest.approx(2.0 + 4e-8 * TEXELS + 0.05)
    assert model.bake(HEAD, "redraw", 61, 2) == pytest.approx(
        2.0 + 31 * model.frame(HEAD, "redraw")
    )
    assert model.file_bytes(HEAD) == pytest.approx(3.5 * TEXELS)


def test_a_device_is_full_however_many_processes_share_it() -> None:
    model = Model(KNOWN)

    assert model.rate(HEAD, "redraw", 1) == pytest.approx(1 / model.frame(HEAD, "redraw"))
    assert model.rate(HEAD, "redraw", 1000) == pytest.approx(1 / model.draw(HEAD, "redraw"))


def test_a_slow_store_sets_the_pace_and_the_price() -> None:
    model = Model(KNOWN)
    fast = model.job(HEAD, "redraw", 1000, devices=10)
    slow = model.job(HEAD, "redraw", 1000, devices=10, store=1e6, price=3.6)

    assert fast.seconds == pytest.approx(2.0 + 100 * model.frame(HEAD, "redraw"))
    assert slow.seconds == pytest.approx(2.0 + 1000 * 3.5 * TEXELS / 1e6)
    assert slow.money == pytest.approx(10 * slow.seconds / 1000)
    assert slow.frame_money == pytest.approx(slow.money / 1000)


@pytest.mark.parametrize("wrong", [{"frames": 0}, {"frames": 1, "devices": 0}])
def test_a_job_of_nothing_is_refused(wrong: dict[str, int]) -> None:
    with pytest.raises(InputError, match="at least 1"):
        Model(KNOWN).job(HEAD, "redraw", **wrong)


def test_an_unknown_method_is_refused() -> None:
    with pytest.raises(InputError, match="'drawn': one of redraw, binned"):
        Model(KNOWN).once(HEAD, "drawn")


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ("[", "is not JSON"),
        ("[]", "an object was expected"),
        ("{}", "has no 'results'"),
        ('{"results": 1}', "'results' is 1, not of kind list"),
        ('{"results": [{"implementation": "rhytid", "case": "redraw"}]}', "has no 'seconds'"),
    ],
)
def test_bad_figures_are_named(tmp_path: Path, content: str, reason: str) -> None:
    file = tmp_path / "bench.json"
    file.write_text(content)

    with pytest.raises(InputError, match=rf"bench\.json.*{reason}"):
        read_frame(file)


def test_a_bad_run_is_named(tmp_path: Path) -> None:
    file = tmp_path / "runs.json"
    file.write_text('{"runs": [{"size": "large"}]}')

    with pytest.raises(InputError, match=r"runs\.json: 'size' is 'large'"):
        read_runs(file)


def test_figures_of_two_devices_are_refused() -> None:
    other = Frame("other", 1024, 1, {}, {})
    with pytest.raises(InputError, match="of one device"):
        Constants.of([frame(1024, 100_000), other], [run(1024, 8)])


def test_constants_need_a_run() -> None:
    with pytest.raises(InputError, match="a run of one process by redraw"):
        Constants.of([frame(1024, 100_000)], [run(1024, 8, "binned")])


def test_the_command_prints_a_job(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bench, runs = tmp_path / "bench.json", tmp_path / "runs.json"
    bench.write_text(json.dumps(_bench(frame(1024, 100_000))))
    runs.write_text(json.dumps({"runs": [vars(run(1024, 8))]}))
    given = ["cost", "--bench", str(bench), "--runs", str(runs), "--size", "1024"]
    given += ["--wrinkles", "100000", "--frames", "10", "--json", str(tmp_path / "cost.json")]

    assert main(given) == 0
    assert "money a frame" in capsys.readouterr().out
    cost = json.loads((tmp_path / "cost.json").read_text())
    assert cost["seconds"] == pytest.approx(Model(KNOWN).bake(HEAD, "redraw", 10))


def test_the_command_says_what_is_wrong(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["page", "nowhere.md"]) == 1
    assert "nowhere.md" in capsys.readouterr().err


def _bench(known: Frame) -> dict[str, Any]:
    rows = [
        {
            "case": case,
            "implementation": "rhytid",
            "seconds": seconds,
            "processor_seconds": known.processor[case],
        }
        for case, seconds in known.seconds.items()
    ]
    return {"device": "device", "size": 1024, "wrinkles": known.wrinkles, "results": rows}
