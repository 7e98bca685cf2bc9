# SPDX-License-Identifier: BSD-3-Clause
"""Signal handlers while the library works: their exceptions are raised, and work goes on if they return."""

import os
import signal
import threading
from concurrent.futures import Future

import numpy as np
import pytest
import symsde as ss
from conftest import rotation_gradient, rotation_hessian, rotation_value
from sender import HandledError, Sender, handled, raises, sent
from symsde.answers.expectation.answer import Answer, Multilevel

LAST = getattr(signal, "SIGRTMAX", signal.SIGUSR2)
PLACE = {"q0": 1.0, "p0": 0.0}
LONG = {**PLACE, "step": 1e-3, "steps": 10**9, "save_every": 10**8}
SHORT = {**PLACE, "step": 1e-3, "steps": 4000, "save_every": 2000, "paths": 2048, "threads": 1}
HORIZON = {**PLACE, "horizon": 2.0, "threads": 1}


def prepared(model, **options):
    steps, every = options.pop("steps"), options.pop("save_every")
    run = ss.prepare(model, **options)
    return lambda: run.run(steps, every)


#: name of a call -> the call for a model and options; and the type of result that the exception carries
CALLS = {
    "simulate": (lambda model, run: lambda: ss.simulate(model, **run), ss.Run),
    "moments": (lambda model, run: lambda: ss.moments(model, **run), ss.Moments),
    "prepared": (lambda model, run: prepared(model, **run), ss.Run),
}
#: name of a call -> the call for a model, and its type of result; such calls choose themselves how long they run
WORKS = {
    "expect": (lambda model: lambda: ss.expect(model, "q**2", abs=1e-4, scheme="midpoint", **HORIZON), Answer),
    "mlmc": (lambda model: lambda: ss.mlmc(model, "q**2", abs=1e-4, **HORIZON), Multilevel),
    "convergence": (lambda model: lambda: ss.convergence(model, paths=400, **HORIZON), None),
}


def arrays(result):
    """The numbers of a result."""
    if isinstance(result, ss.Run):
        return [result.q, result.p, result.status]
    if isinstance(result, ss.Moments):
        return [result.n_ok, *result.to_arrays()]
    return [result.error, result.low, result.high]


@pytest.mark.parametrize("number", [signal.SIGALRM, signal.SIGUSR1, signal.SIGTERM, signal.SIGINT, LAST])
@pytest.mark.parametrize("name", CALLS)
def test_what_a_handler_raises_is_raised_with_what_there_is(name, number, kubo):
    make, kind = CALLS[name]
    call = make(kubo, {**LONG, "paths": 3})
    with handled(number, raises), sent(number, at=2), pytest.raises(HandledError) as caught:
        call()
    found = caught.value.partial
    assert isinstance(found, kind) and found.report.outcome == "stopped on request"


@pytest.mark.parametrize("name", CALLS)
def test_where_a_handler_returns_the_run_goes_on(name, kubo):
    """A run with signals whose handlers return has the same bits, however many signals there are."""
    seen = []
    call = CALLS[name][0]
    wanted = call(kubo, dict(SHORT))()
    for number in (signal.SIGUSR1, signal.SIGINT):
        with handled(number, lambda number, _: seen.append(number)), sent(number):
            found = call(kubo, dict(SHORT))()
        assert seen.pop() == number and not seen
        assert found.report.outcome == "ok"
        for x, y in zip(arrays(found), arrays(wanted), strict=True):
            np.testing.assert_array_equal(x, y)


@pytest.mark.parametrize("at", [1, 5])
@pytest.mark.parametrize("name", WORKS)
def test_what_a_handler_raises_ends_long_work(name, at):
    make, kind = WORKS[name]
    model = ss.models.synchrotron()
    with handled(signal.SIGALRM, raises), sent(signal.SIGALRM, at), pytest.raises(HandledError) as caught:
        make(model)()
    if kind is not None:
        assert caught.value.partial is None or isinstance(caught.value.partial, kind)


@pytest.mark.parametrize("method", ["plain", "multilevel"])
def test_what_a_handler_raises_carries_an_answer(method, kubo):
    """A signal comes during the work, which reports its progress: the exception carries an answer."""
    with handled(signal.SIGALRM, raises), pytest.raises(HandledError) as caught:
        tell = {"progress": lambda *_: signal.raise_signal(signal.SIGALRM)}
        ss.expect(kubo, "q**2", abs=1e-3, method=method, scheme="midpoint", **tell, **HORIZON)
    assert isinstance(caught.value.partial, Answer) and not caught.value.partial.reached


def test_where_a_handler_returns_convergence_counts_all_paths():
    seen = []
    call = WORKS["convergence"][0](ss.models.synchrotron())
    wanted = call()
    with handled(signal.SIGTERM, lambda *_: seen.append(1)), sent(signal.SIGTERM):
        found = call()
    assert seen == [1] and found.paths == wanted.paths == 400
    np.testing.assert_array_equal(found.error, wanted.error)


@pytest.mark.parametrize("threads", [1, 2])
def test_an_ensemble_gives_its_shards(threads, kubo):
    """Threads of an ensemble compute while the main thread waits: a handler that returns lets it go on waiting, a
    handler that raises ends it.
    """

    def tells(done, total):
        if done and seen == []:
            seen.append(done)
            signal.raise_signal(signal.SIGUSR1)
        return False

    run = {**SHORT, "paths": 2048, "threads": threads, "shard_paths": 256}
    seen = []
    with handled(signal.SIGUSR1, lambda *_: None):
        whole = ss.ensemble(kubo, progress=tells, **run)
    assert whole.n_ok[-1] == 2048
    seen = []
    with handled(signal.SIGUSR1, raises), pytest.raises(HandledError) as caught:
        ss.ensemble(kubo, progress=tells, **run)
    assert 0 < caught.value.partial.n_ok[-1] < 2048
    assert caught.value.partial.report.stopped == 2048 - caught.value.partial.n_ok[-1]


def test_a_handler_that_was_made_in_the_run_counts(kubo):
    """A progress function sets a handler for an alarm."""
    before = signal.getsignal(signal.SIGALRM)
    with Sender(signal.SIGALRM, at=2) as sender:

        def progress(done, total):
            if sender.calls == 0:
                signal.signal(signal.SIGALRM, raises)
            return sender.told()

        with pytest.raises(HandledError) as caught:
            ss.simulate(kubo, paths=3, progress=progress, **LONG)
    assert caught.value.partial.report.stopped == 3
    assert signal.signal(signal.SIGALRM, before) is raises


def test_handlers_of_several_signals_are_all_called(kubo):
    """The exception of the last handler is raised, with those of the others as its context."""

    def progress(done, total):
        signal.raise_signal(signal.SIGALRM)
        signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGUSR1)

    seen = []
    with (
        handled(signal.SIGALRM, raises), handled(signal.SIGTERM, raises),
        handled(signal.SIGUSR1, lambda number, _: seen.append(number)), pytest.raises(HandledError) as caught,
    ):  # fmt: skip
        ss.moments(kubo, paths=3, progress=progress, **LONG)
    assert seen == [signal.SIGUSR1] and caught.value.args == (signal.SIGTERM,)
    assert caught.value.__context__.args == (signal.SIGALRM,)
    assert caught.value.partial.report.stopped == 3


def model_of(gradient):
    return ss.Model(ndof=1, nnoise=1, gradient=gradient, hessian=rotation_hessian, value=rotation_value)


def test_a_second_signal_ends_a_callback_at_once(kubo):
    """The first signal waits for the library's next question, which never comes if a callback hangs."""

    def hangs(t, w, q, p):
        signal.raise_signal(signal.SIGINT)
        told.append("once")
        signal.raise_signal(signal.SIGINT)
        told.append("never")
        return rotation_gradient(t, w, q, p)

    told = []
    model = model_of(lambda t, w, q, p: hangs(t, w, q, p) if t > 1 else rotation_gradient(t, w, q, p))
    with pytest.raises(KeyboardInterrupt) as caught:
        ss.simulate(model, q0=1.0, p0=0.0, step=0.1, steps=40)
    assert told == ["once"]
    run = caught.value.partial
    assert run.report.outcome == "a user callback reported failure" and run.failed_step.tolist() == [10]
    assert np.isnan(run.q[11:]).all()
    good = ss.simulate(model_of(rotation_gradient), q0=1.0, p0=0.0, step=0.1, steps=10)
    np.testing.assert_array_equal(run.q[:11], good.q)


def model_that_signals(number):
    """A model whose gradient sends a signal in the first call after it is armed, and the switch that arms it."""
    armed = threading.Event()

    def gradient(t, w, q, p):
        if armed.is_set():
            armed.clear()
            signal.raise_signal(number)
        return rotation_gradient(t, w, q, p)

    return model_of(gradient), armed


@pytest.mark.parametrize("what", ["prepare", "gradient", "expect"])
def test_calls_without_progress_raise_what_handlers_raise(what):
    """Functions of the library without a progress function call Python functions: exceptions of handlers are raised."""
    model, armed = model_that_signals(signal.SIGALRM)
    calls = {
        "prepare": lambda: ss.prepare(model, step=0.1, **PLACE),
        "gradient": lambda: model.gradient(1.0, 0.0),
        "expect": lambda: ss.expect(model, "q", abs=1e-2, **HORIZON),
    }
    armed.set()
    with handled(signal.SIGALRM, raises), pytest.raises(HandledError):
        calls[what]()


def test_a_step_is_not_spoilt_by_a_handler():
    """The handler is called when the step is done, since its exception inside a callback would leave outputs unset."""
    model, armed = model_that_signals(signal.SIGALRM)
    run, good = (ss.prepare(x, step=0.1, **PLACE) for x in (model, model_of(rotation_gradient)))
    with handled(signal.SIGALRM, raises):
        for _ in range(20):
            armed.set()
            with pytest.raises(HandledError):
                run.step()
            good.step()
    assert run.next_step == 20 and run.report.counters == good.report.counters
    np.testing.assert_array_equal(run.q, good.q)


def test_a_handler_in_the_main_thread_leaves_the_run_of_another_alone(kubo):
    """The handler belongs to the main thread and raises there; the other thread's run goes on to its end."""
    go, found, wanted = threading.Event(), Future(), ss.simulate(kubo, **SHORT)

    def work():
        go.wait()
        found.set_result(ss.simulate(kubo, **SHORT))

    worker = threading.Thread(target=work)
    worker.start()
    with handled(signal.SIGALRM, raises), sent(signal.SIGALRM):
        with pytest.raises(HandledError):
            go.set()
            found.result()
        np.testing.assert_array_equal(found.result().q, wanted.q)
    worker.join()


@pytest.mark.parametrize("arrives", [signal.SIGUSR1, signal.SIGALRM])
def test_handlers_are_given_back_whatever_happens(arrives, kubo, monkeypatch):
    """Handlers are restored even if one raises while they are exchanged, whether before or after the library's own."""
    from symsde.native import signals

    swap, numbers = signals.signal.signal, (signal.SIGUSR1, signal.SIGUSR2, signal.SIGALRM)

    def restless(number, handler):
        result = swap(number, handler)
        if number == signal.SIGUSR2:
            os.kill(os.getpid(), arrives)
        return result

    before = signal.getsignal(signal.SIGINT)
    with handled(numbers[0], raises), handled(numbers[1], raises), handled(numbers[2], raises):
        with monkeypatch.context() as patch:
            patch.setattr(signals.signal, "signal", restless)
            with pytest.raises(HandledError):
                ss.simulate(kubo, **PLACE, step=0.1, steps=1)
        assert all(signal.getsignal(number) is raises for number in numbers)
        assert signal.getsignal(signal.SIGINT) is before
    assert ss.simulate(kubo, **PLACE, step=0.1, steps=1).report.outcome == "ok"
