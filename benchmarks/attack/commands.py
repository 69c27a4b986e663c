"""Commands on hostile input: how they end, in which time, with which memory and text."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from typing import Final

from benchmarks.attack.outcome import Outcome
from benchmarks.attack.target import MAX_MEMORY, TRACEBACK

MAX_SECONDS: Final = 10.0  # of processor time
MAX_WAIT: Final = (
    90.0  # [s], since the machine may be busy: who waits for ever has no processor time
)


def outcome_of(words: list[str]) -> Outcome:
    """Run ``hereabouts WORDS``; a death by a signal is a crash, exit codes 0 to 2 are none."""
    with tempfile.TemporaryFile() as output:
        command = [sys.executable, "-m", "hereabouts.cli", *words]
        process = subprocess.Popen(command, stdout=output, stderr=output, stdin=subprocess.DEVNULL)
        waited, status, usage = _end(process)
        output.seek(0)
        text = output.read(1 << 20).decode(errors="replace")
    hung = not waited or usage.ru_utime + usage.ru_stime > MAX_SECONDS
    crashed = waited and os.waitstatus_to_exitcode(status) not in (0, 1, 2)
    shown = TRACEBACK in text
    if hung or crashed or shown:
        last = text.strip().splitlines()[-1:]
        sys.stderr.write(f"hereabouts {' '.join(words)}: {last}, hung {hung}\n")
    greedy = usage.ru_maxrss > MAX_MEMORY
    return Outcome(1, 0, int(crashed), int(hung), 0, int(greedy), int(shown))


def _end(process: subprocess.Popen[bytes]) -> tuple[bool, int, os._ResourceUsage]:
    """Whether it ended by itself, its status, and what it used."""
    end = time.monotonic() + MAX_WAIT
    while time.monotonic() < end:
        pid, status, usage = os.wait4(process.pid, os.WNOHANG)
        if pid:
            process.returncode = os.waitstatus_to_exitcode(status)
            return True, status, usage
        time.sleep(0.02)
    process.kill()
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    return False, status, usage
