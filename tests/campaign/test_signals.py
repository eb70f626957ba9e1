"""Signals of a batch system and of a terminal, sent to this process."""

import os
import signal
from collections.abc import Iterator

import pytest

from roughvol.campaign import signals


@pytest.fixture(autouse=True)
def handled() -> Iterator[None]:
    """Signals as Python handles them: a shell ignores SIGINT in a job in the background, and so do its children."""
    before = {number: signal.getsignal(number) for number in signals.ALL}
    for number in signals.ALL:
        signal.signal(number, signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL)
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


NUMBERS = pytest.mark.parametrize("number", signals.ALL, ids=lambda number: number.name)


@NUMBERS
def test_a_signal_is_an_interrupt_with_its_number(number: signal.Signals) -> None:
    before = signal.getsignal(number)
    with pytest.raises(KeyboardInterrupt) as caught, signals.as_interrupts():
        os.kill(os.getpid(), number)
    assert signals.number_of(caught.value) == number
    assert signal.getsignal(number) is before


@NUMBERS
def test_the_first_signal_asks_and_the_second_interrupts(number: signal.Signals) -> None:
    told: list[int] = []
    with signals.first_interrupt(lambda: told.append(1)) as arrived:
        assert not arrived()
        os.kill(os.getpid(), signal.SIGTERM)
        assert arrived()
        with pytest.raises(KeyboardInterrupt) as caught:
            os.kill(os.getpid(), number)
    assert (told, signals.number_of(caught.value)) == ([1], number)


def test_a_run_that_stops_where_it_was_asked_names_the_signal() -> None:
    def run() -> None:
        with signals.first_interrupt(lambda: None):
            os.kill(os.getpid(), signal.SIGHUP)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as caught:
        run()
    assert signals.number_of(caught.value) == signal.SIGHUP


def test_an_ignored_signal_stays_ignored() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup does
    try:
        with signals.first_interrupt(lambda: None) as arrived:
            os.kill(os.getpid(), signal.SIGHUP)
            assert not arrived()
    finally:
        signal.signal(signal.SIGHUP, before)


def test_signals_are_blocked_while_a_process_starts() -> None:
    with signals.blocked():
        assert set(signals.ALL) <= signal.pthread_sigmask(signal.SIG_BLOCK, [])
    assert not set(signals.ALL) & signal.pthread_sigmask(signal.SIG_BLOCK, [])
