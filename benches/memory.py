"""Peak memory of ``streamseg segment`` on one flight pass, and on many of them laid end to end.

Memory should depend on the window, never on the length of the stream. 20 copies may take less than a tenth more than
one, 40 less than 3 % more than 10, and none 500 MB. The peak is the kernel's own count of resident pages
(``ru_maxrss``), which includes the interpreter, its libraries and the program's code; the proportional set size, in
which pages that other processes use too count in part, is sampled beside it.

    python benches/memory.py
    python benches/memory.py --copies 1 20 --threads 2

With ``--max-memory`` spans and windows are chosen to keep to a budget, and the peak has to stay below it. What this
program does not know goes to ``streamseg segment`` as it is, so any method can be measured on any cloud.

    python benches/memory.py --max-memory 256 --copies 20
    python benches/memory.py --max-memory 256 --copies 1 --cloud pines.laz --method dbscan --eps 0.05
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import subprocess
import sysconfig
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from measuring import DATA

# From so many copies to so many: how much more memory they may take.
GREATEST_GROWTH = {(1, 20): 0.10, (10, 40): 0.03}
GREATEST_PEAK = 500e6
_CHUNK = 250_000
_SAMPLED_EVERY = 0.1


class Peak(NamedTuple):
    """What a run on a cloud of so many copies took, on so many threads."""

    copies: int
    threads: int
    points: int
    seconds: float
    resident: float
    """Bytes: the peak of the resident set."""
    proportional: float
    """Bytes: the highest sample of the proportional set; 0 where the system does not tell."""

    @property
    def speed(self) -> float:
        """Points per second."""
        return self.points / self.seconds


def write_copies(source: Path, target: Path, copies: int) -> None:
    """Write a cloud `copies` times, each one shifted along x by its extent, in bounded memory."""
    import laspy

    with laspy.open(source) as reader:
        header = reader.header
        step = round((header.maxs[0] - header.mins[0]) / header.scales[0]) + 1
    with laspy.open(target, mode="w", header=header) as writer:
        for copy in range(copies):
            with laspy.open(source) as reader:
                for points in reader.chunk_iterator(_CHUNK):
                    points.X = points.X + copy * step
                    writer.write_points(points)


def write_aside(source: Path, target: Path, copies: int) -> None:
    """Write the copies in a process of its own; the kernel's peak of a child starts at what its parent holds."""
    writer = multiprocessing.get_context("spawn").Process(target=write_copies, args=(source, target, copies))
    writer.start()
    writer.join()
    if writer.exitcode:
        raise SystemExit(f"could not write {copies} copies of {source}")


def points_of(path: Path) -> int:
    """How many points the header of a LAS or LAZ file announces."""
    import laspy

    with laspy.open(path) as reader:
        return int(reader.header.point_count)


def measure(cloud: Path, output: Path, copies: int, threads: int, options: list[str]) -> Peak:
    """Segment a file from the command line and watch the process until it ends."""
    command = [str(Path(sysconfig.get_path("scripts")) / "streamseg"), "segment", str(cloud), str(output), *options]
    command += ["--threads", str(threads)]
    begun = time.perf_counter()
    child = subprocess.Popen([*command, "--quiet"])
    proportional = 0.0
    while True:
        pid, status, usage = os.wait4(child.pid, os.WNOHANG)
        if pid:
            break
        proportional = max(proportional, proportional_set(child.pid))
        time.sleep(_SAMPLED_EVERY)
    seconds = time.perf_counter() - begun
    child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode:
        raise SystemExit(f"{' '.join(command)} ended with status {child.returncode}")
    return Peak(copies, threads, points_of(cloud), seconds, usage.ru_maxrss * 1024.0, proportional)


def proportional_set(pid: int) -> float:
    """Bytes of the proportional set of a process, 0 if that cannot be known."""
    try:
        with open(f"/proc/{pid}/smaps_rollup") as rollup:
            return next((float(line.split()[1]) * 1024 for line in rollup if line.startswith("Pss:")), 0.0)
    except OSError:
        return 0.0


def measure_all(cloud: Path, copies: list[int], threads: list[int], repeats: int, options: list[str]) -> list[Peak]:
    """Measure each number of copies on each number of threads; of several runs the one with the highest peak counts."""
    peaks = []
    with tempfile.TemporaryDirectory(prefix="streamseg-memory-") as folder:
        for count in copies:
            laid, output = Path(folder) / f"{count}.laz", Path(folder) / "labelled.laz"
            write_aside(cloud, laid, count)
            for number in threads:
                runs = []
                for _ in range(repeats):
                    runs.append(measure(laid, output, count, number, options))
                    output.unlink()
                peaks.append(max(runs, key=lambda run: run.resident))
                print(line(peaks[-1]), flush=True)
            laid.unlink()
    return peaks


def line(peak: Peak) -> str:
    """One row of the table."""
    return (
        f"{peak.copies:>6} {peak.threads:>7} {peak.points:>12,} {peak.seconds:>8.1f} {peak.speed / 1e6:>10.2f} "
        f"{peak.resident / 1e6:>12.0f} {peak.proportional / 1e6:>10.0f}"
    )


def report_budget(peaks: list[Peak], budget: float) -> bool:
    """Print the highest peak and the budget; whether it was kept."""
    peak = max(each.resident for each in peaks)
    kept = peak <= budget
    print(f"\nhighest peak {peak / 1e6:.0f} MB (budget: {budget / 1e6:.0f} MB: {'kept' if kept else 'BROKEN'})")
    return kept


def report(peaks: list[Peak]) -> bool:
    """Print what more points take, and the bars; whether they are met."""
    resident = {(peak.threads, peak.copies): peak.resident for peak in peaks}
    met = True
    print()
    for threads in sorted({peak.threads for peak in peaks}):
        for (few, many), bar in GREATEST_GROWTH.items():
            if (threads, few) in resident and (threads, many) in resident:
                growth = resident[threads, many] / resident[threads, few] - 1
                met &= growth < bar
                print(
                    f"threads {threads}: {many} copies take {growth:+.1%} memory against {few} "
                    f"(bar: less than {bar:.0%}: {'met' if growth < bar else 'MISSED'})"
                )
    highest = max(resident.values())
    is_small = highest < GREATEST_PEAK
    print(f"highest peak {highest / 1e6:.0f} MB (bar: {GREATEST_PEAK / 1e6:.0f} MB: {'met' if is_small else 'MISSED'})")
    return met and is_small


def main() -> None:
    """Measure, print, and say whether the bars are met."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cloud", type=Path, default=DATA / "als" / "hawaii_pass.laz", help="what is laid end to end")
    parser.add_argument(
        "--copies", type=int, nargs="+", default=[1, 5, 10, 20, 40], help="how often [default: 1 5 10 20 40]"
    )
    parser.add_argument("--repeats", type=int, default=1, help="runs per number of copies; the highest peak counts")
    parser.add_argument("--distance", type=float, default=1.0, help="of the proximity segmentation")
    parser.add_argument("--span-width", type=float, default=20.0, help="width of the spans")
    parser.add_argument("--max-memory", type=int, help="budget in MB, instead of a width")
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2], help="how many [default: 1 2]")
    parser.add_argument("--result", default="final", choices=("final", "carry", "history"), help="which ids")
    parser.add_argument("--json", type=Path, help="also write the figures here")
    given, method = parser.parse_known_args()
    is_budget = given.max_memory is not None
    cut = ["--max-memory", f"{given.max_memory}MB"] if is_budget else ["--span-width", str(given.span_width)]
    options = [*(method or ["--distance", str(given.distance)]), *cut, "--result", given.result]
    print(f"streamseg segment {' '.join(options)}, {given.cloud.name} laid end to end\n")
    columns = [f"{'copies':>6} {'threads':>7} {'points':>12} {'seconds':>8}"]
    columns += [f"{'Mpoints/s':>10} {'peak RSS, MB':>12} {'PSS, MB':>10}"]
    print(" ".join(columns))
    peaks = measure_all(given.cloud, given.copies, given.threads, given.repeats, options)
    met = report_budget(peaks, given.max_memory * 1e6) if is_budget else report(peaks)
    if given.json:
        runs = [{**peak._asdict(), "points_per_second": peak.speed} for peak in peaks]
        given.json.write_text(json.dumps({"cloud": given.cloud.name, "options": options, "runs": runs, "met": met}))
    raise SystemExit(0 if met else 1)


if __name__ == "__main__":
    main()
