"""Workers that die, run out of memory, are halted or lose their scheduler: each piece of work ends once, with a reason."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from dmp.batch import asking, attending, engine
from dmp.batch.asking import Workers, ask
from dmp.batch.cluster import connect
from dmp.batch.engine import Engine, Finished, Means, Work
from tests.dmp.batch import works
from tests.dmp.batch.conftest import LIGHT_MEMORY_LIMIT


def run_works(cluster: Any, todo: list[Work], **means: Any) -> dict[str, Finished]:
    """Have work done; no piece of it ends twice."""
    ended: dict[str, Finished] = {}
    for finished in Engine(Means(connect=lambda: connect(cluster.scheduler.address), **means)).run(todo):
        assert finished.name not in ended
        ended[finished.name] = finished
    return ended


def pids(cluster: Any) -> dict[str, int]:
    return dict(ask(cluster, os.getpid))


def test_work_that_kills_its_workers_fails_with_a_reason(light_cluster: Any) -> None:
    ended = run_works(light_cluster, [Work("deadly", works.die, tuple), Work("good", works.answer, lambda: (7,))])
    assert ended["good"].result == 7
    assert ended["deadly"].result is None
    assert "2 workers were lost" in ended["deadly"].failure
    assert "memory" in ended["deadly"].failure
    assert len(ended["deadly"].retries) == 2


def test_work_that_is_killed_for_its_memory_fails_with_a_reason(light_cluster: Any) -> None:
    todo = [Work("large", works.grow, lambda: (2 * LIGHT_MEMORY_LIMIT,)), Work("good", works.answer, lambda: (7,))]
    ended = run_works(light_cluster, todo)
    assert ended["good"].result == 7
    assert ended["large"].result is None
    assert "Perhaps its memory ran out" in ended["large"].failure
    assert len(ended["large"].retries) == 2


def test_a_worker_that_dies_while_it_is_started_comes_all_the_same(light_cluster: Any) -> None:
    keepers = list(light_cluster.cluster.workers.values())
    for keeper in keepers:
        os.kill(keeper.pid, signal.SIGKILL)
    killed = {keeper.pid for keeper in keepers}
    deadline = time.monotonic() + 30
    hit = set()
    while len(hit) < len(keepers):
        assert time.monotonic() < deadline
        for keeper in keepers:
            process = keeper.process
            if keeper not in hit and process is not None and process.status.name == "starting" and process.pid:
                hit.add(keeper)
                os.kill(process.pid, signal.SIGKILL)
        time.sleep(0.01)
    while len(found := set(pids(light_cluster).values())) < 2:
        assert time.monotonic() < deadline
        time.sleep(0.1)
    assert not found & killed
    assert run_works(light_cluster, [Work("good", works.answer, lambda: (7,))])["good"].result == 7


def test_an_error_ends_its_own_work_only(light_cluster: Any) -> None:
    ended = run_works(
        light_cluster,
        [Work("bad", works.fail, lambda: ("what <went> wrong",)), Work("full", works.use_up, tuple)]
        + [Work(f"good{number}", works.answer, lambda number=number: (number,)) for number in range(6)],
    )
    assert "RuntimeError: what <went> wrong" in ended["bad"].failure
    assert "not enough memory" in ended["full"].failure
    assert [ended[f"good{number}"].result for number in range(6)] == list(range(6))


def test_a_halted_worker_answers_nobody_and_holds_nobody_up(
    light_cluster: Any, halted: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(asking, "ANSWER_SECONDS", 1.0)
    monkeypatch.setattr(engine, "_SILENT_SECONDS", 3.0)
    by_address = pids(light_cluster)
    silent, other = sorted(by_address)
    halted.append(by_address[silent])
    os.kill(halted[0], signal.SIGSTOP)
    workers = Workers()
    assert workers.ask(light_cluster, os.getpid) == {other: by_address[other]}
    # It is not waited for again, as long as another one answers.
    began = time.monotonic()
    assert workers.ask(light_cluster, os.getpid, seconds=30) == {other: by_address[other]}
    assert time.monotonic() - began < 10
    # dask gives work to both; what lies before the one that is halted is taken away from it.
    todo = [Work(f"good{number}", works.wait, lambda: (0.2,)) for number in range(3)]
    ended = run_works(light_cluster, todo)
    assert [item.result for item in ended.values()] == [0.2] * 3
    [retry] = [text for item in ended.values() for text in item.retries]
    assert f"{silent} did not move any more and was started anew" in retry
    # And the next ones find both as they should be.
    assert not any(item.retries for item in run_works(light_cluster, todo).values())


def test_a_halted_worker_does_not_keep_from_stopping(light_cluster: Any, halted: list[int]) -> None:
    stop = threading.Event()
    halted.append(min(pids(light_cluster).items())[1])
    os.kill(halted[0], signal.SIGSTOP)
    todo = [Work(f"long{number}", works.wait, lambda: (60.0,)) for number in range(2)]
    means = Means(connect=lambda: connect(light_cluster.scheduler.address), stop_seconds=1.0)
    began = time.monotonic()
    ended = list(Engine(means, stop=stop, told=lambda _name, share: stop.set() if share else None).run(todo))
    assert time.monotonic() - began < 20
    # The one that is at work ends after its step. The other one is let go, and is told of if the halted worker had begun it.
    assert ended
    assert all(finished.interrupted is not None for finished in ended)
    names = [finished.name for finished in ended]
    assert len(set(names)) == len(names)


def test_work_under_way_stays_within_the_memory() -> None:
    engine = Engine(Means(connect=lambda: None, memory=10))
    sizes = {"a": 6, "b": 6, "c": 3, "d": 20}
    state = works.state_of([Work(name, works.answer, tuple, memory=size) for name, size in sizes.items()])
    first = engine._next_that_fits(state)
    assert first is not None
    assert first.name == "a"
    works.begin(state, first)
    second = engine._next_that_fits(state)
    assert second is not None
    # The next that fits beside it; nobody waits for ever, because alone each one is tried.
    assert second.name == "c"
    works.begin(state, second)
    assert engine._next_that_fits(state) is None
    state.under_way.clear()
    assert [engine._next_that_fits(state).name for _ in range(2) if not state.under_way.clear()] == ["b", "d"]  # type: ignore[union-attr]


@contextmanager
def threads_as_workers(port: int = 0) -> Iterator[int]:
    """A scheduler and two workers in threads of this process, which come and go fast."""
    import dask
    from distributed import LocalCluster

    with (
        dask.config.set({"distributed.scheduler.worker-saturation": 1.0}),
        LocalCluster(
            2, threads_per_worker=1, processes=False, protocol="tcp", host="127.0.0.1", scheduler_port=port,
            dashboard_address=None, silence_logs=100,
        ) as cluster,
    ):  # fmt: skip
        yield int(cluster.scheduler_address.rsplit(":", 1)[1])


def test_work_outlives_a_restart_of_the_scheduler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(attending, "_TOLD_EVERY_SECONDS", 0.1)
    said: list[str] = []
    ended: dict[str, Finished] = {}
    reached, done = threading.Event(), threading.Event()
    port_known: list[int] = []

    def keep_scheduler() -> None:
        with threads_as_workers() as port:
            port_known.append(port)
            reached.wait(30)
        with threads_as_workers(port_known[0]):
            done.wait(60)

    shares: list[float] = []

    def tell(_name: str, share: float) -> None:
        if share > 0.2:
            reached.set()
        shares.append(share if any("scheduler" in text for text in said) else 0.0)

    keeping = threading.Thread(target=keep_scheduler)
    keeping.start()
    try:
        while not port_known:
            time.sleep(0.05)
        connect_here = Means(connect=lambda: connect(f"127.0.0.1:{port_known[0]}"), patience_seconds=30)
        todo = [Work(f"work{number}", works.wait, lambda: (0.5,)) for number in range(4)]
        for finished in Engine(connect_here, told=tell, said=said.append).run(todo):
            assert finished.name not in ended
            ended[finished.name] = finished
    finally:
        reached.set()
        done.set()
        keeping.join(30)
    assert [item.result for item in ended.values()] == [0.5] * 4
    # Who has connected again hears how far the work is.
    assert max(shares) > 0
    assert any("scheduler" in text for text in said)
    assert any("the scheduler was lost" in text for item in ended.values() for text in item.retries)
