"""How often one caller may ask, and how many jobs it may have."""

from __future__ import annotations

from dataclasses import replace

import httpx
import pytest

from api.asking import NPY, built, is_problem, npy
from api.fake_engine import FakeEngine
from api.live import serving
from api.patch import obj, smile, upload
from rhytid.api.access import REMEMBERED, SAVED, Caller, RateLimiter
from rhytid.api.admission import JobShares
from rhytid.engine.messages import JobInfo
from rhytid.errors import NotFoundError, QuotaError, SettingsError
from rhytid.support.settings import ServiceSettings


class Clock:
    now = 50.0

    def __call__(self) -> float:
        return self.now


def test_a_caller_has_its_rate_and_what_it_saved() -> None:
    clock = Clock()
    rates = RateLimiter(clock)
    assert [rates.take("a", 4) for _ in range(int(SAVED * 4))] == [0] * 8
    assert rates.take("a", 4) == 1
    assert rates.take("b", 4) == 0  # another's is its own
    clock.now += 0.5
    assert [rates.take("a", 4) for _ in range(3)] == [0, 0, 1]
    clock.now += 1000
    assert [rates.take("a", 4) for _ in range(9)] == [0] * 8 + [1]


def test_it_is_told_when_to_come_again() -> None:
    clock = Clock()
    rates = RateLimiter(clock)
    slow = 0.25
    assert rates.take("a", slow) == 0
    assert rates.take("a", slow) == 4
    clock.now += 4
    assert rates.take("a", slow) == 0


def test_callers_that_are_remembered_are_bounded() -> None:
    rates = RateLimiter(Clock())
    for i in range(REMEMBERED + 10):
        rates.take(f"address {i}", 1)
    assert len(rates) == REMEMBERED
    last = f"address {REMEMBERED + 9}"
    assert [rates.take(last, 1), rates.take(last, 1)] == [0, 1]  # the newest is not forgotten


def test_who_asks_too_often_is_told_when_to_come_again() -> None:
    with serving(FakeEngine(), key_rate=1) as client:
        answers = [client.get("/v1/assets") for _ in range(20)]
        refused = [answer for answer in answers if answer.status_code != 200]
        assert answers[0].status_code == answers[1].status_code == 200
        assert len(refused) >= 10
        for answer in refused:
            detail = is_problem(answer, 429, "quota")
            assert detail == "address 127.0.0.1 sends more than 1 requests a second"
            assert answer.headers["retry-after"] == "1"
        for _ in range(20):  # who watches whether the server lives is never refused
            assert client.get("/healthz").status_code == 200


@pytest.mark.parametrize("proxies", ["127.0.0.1", "127.0.0.0/8, 10.1.0.0/16"])
def test_behind_a_named_proxy_callers_are_told_apart(proxies: str) -> None:
    """The last address that is no proxy's counts: a caller writes what stands before it."""
    settings = ServiceSettings.from_environment({"RHYTID_PROXIES": proxies})
    with serving(FakeEngine(), key_rate=1, proxies=settings.proxies) as client:

        def answers(address: str, forged: str) -> list[httpx.Response]:
            headers = {"X-Forwarded-For": f"{forged}, {address}"}
            return [client.get("/v1/assets", headers=headers) for _ in range(10)]

        first, second = answers("203.0.113.9", "198.51.100.7"), answers("2001:db8::1", "nobody")
        assert first[0].status_code == second[0].status_code == 200
        assert "address 203.0.113.9 sends more" in is_problem(first[-1], 429, "quota")
        assert "address 2001:db8::/64 sends more" in is_problem(second[-1], 429, "quota")
        garbage = answers("x" * 5000, "203.0.113.9")
        assert "address unknown sends more" in is_problem(garbage[-1], 429, "quota")


@pytest.mark.parametrize("proxies", [(), ("203.0.113.0/24",)])
def test_nobody_else_says_who_asks(
    proxies: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FORWARDED_ALLOW_IPS", "*")
    with serving(FakeEngine(), key_rate=1, proxies=proxies) as client:
        headers = ({"X-Forwarded-For": f"203.0.113.{i}"} for i in range(10))
        answers = [client.get("/v1/assets", headers=one) for one in headers]
        assert "address 127.0.0.1 sends more" in is_problem(answers[-1], 429, "quota")


@pytest.mark.parametrize("wrong", ["proxy.example", "*", "10.0.0.1/8", "10.0.0.0/33", "1.2.3.4:80"])
def test_proxies_are_addresses_and_networks(wrong: str) -> None:
    with pytest.raises(SettingsError, match="RHYTID_PROXIES has"):
        ServiceSettings.from_environment({"RHYTID_PROXIES": f"10.0.0.1,{wrong}"})


CALLER = Caller("key a", 10, 2)
INFO = JobInfo("j", "asset", "build", "running", 0.0, "", "")


@pytest.fixture
def jobs() -> dict[str, JobInfo]:
    return {}


@pytest.fixture
def shares(jobs: dict[str, JobInfo]) -> JobShares:
    def info(id: str) -> JobInfo:
        if id not in jobs:
            raise NotFoundError(id)
        return jobs[id]

    return JobShares(info)


def start(shares: JobShares, jobs: dict[str, JobInfo], name: str, caller: Caller = CALLER) -> None:
    with shares.one(caller) as share:
        jobs[name] = INFO
        share.take(name)


def test_a_place_is_free_again_when_its_job_has_ended(
    shares: JobShares, jobs: dict[str, JobInfo]
) -> None:
    start(shares, jobs, "one")
    start(shares, jobs, "two")
    with pytest.raises(QuotaError, match="key a has 2 unfinished jobs: at most 2"):
        start(shares, jobs, "three")
    start(shares, jobs, "four", replace(CALLER, name="key b"))
    jobs["one"] = replace(INFO, state="failed")
    start(shares, jobs, "five")
    del jobs["two"]  # its asset was removed
    start(shares, jobs, "six")


def test_a_place_is_free_again_where_no_job_came_of_it(
    shares: JobShares, jobs: dict[str, JobInfo]
) -> None:
    for _ in range(5):
        with pytest.raises(ZeroDivisionError), shares.one(CALLER):
            raise ZeroDivisionError
        with shares.one(CALLER) as share:
            share.take(None)
    with shares.one(CALLER), shares.one(CALLER), pytest.raises(QuotaError):
        start(shares, jobs, "beside two that are on their way")


def test_who_has_too_many_jobs_is_refused_before_its_upload_is_read() -> None:
    with serving(FakeEngine(polls=1000), key_jobs=2) as client:
        for scale in (1.0, 2.0):
            assert client.post("/v1/assets", files=upload(obj(scale))).status_code == 202
        answer = client.post("/v1/assets", content=b"no form at all")
        assert "2 unfinished jobs: at most 2" in is_problem(answer, 429, "quota")
        assert answer.headers["retry-after"] == "1"


def test_a_calibration_counts_among_the_jobs() -> None:
    engine = FakeEngine()
    with serving(engine, key_jobs=1) as client:
        path = f"/v1/assets/{built(client, upload())}"
        engine.state.polls = 1000
        send = {"content": npy(smile()), "headers": NPY}
        assert client.put(f"{path}/calibration", **send).status_code == 202
        is_problem(client.put(f"{path}/calibration", **send), 429, "quota")
