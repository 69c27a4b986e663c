"""Report of a trial: scores of each search method, as a table or as JSON."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass

from benchmarks.search.scores import HORIZON, Score, score
from benchmarks.search.trial import METHODS, PARTS, SILENT, Searched, TrialSettings


@dataclass(frozen=True, slots=True)
class Report:
    """Scores by name."""

    methods: Mapping[str, Score]  # the five ways; all take pictures on the way
    silent: Mapping[str, Score]  # the same that take none
    parts: Mapping[str, Score]  # ours without some of its parts
    robustness: Mapping[str, Score]  # with beliefs that mislead; empty unless asked for
    settings: TrialSettings
    slower: int  # queries for which ours takes more than three times as long as the thesis' rule

    def to_json(self) -> dict[str, object]:
        """The five ways at the top level, then variants and settings; plain values."""
        values: dict[str, object] = {name: _plain(s) for name, s in self.methods.items()}
        values["nothing_on_the_way"] = {name: _plain(s) for name, s in self.silent.items()}
        values["variants"] = {name: _plain(s) for name, s in self.parts.items()}
        if self.robustness:
            values["robustness"] = {name: _plain(s) for name, s in self.robustness.items()}
        values["slower_than_three_times_the_rule"] = self.slower
        values["settings"] = _settings(self.settings)
        return values

    def ratios(self) -> Iterator[str]:
        """Ratios of the mean times, in sentences."""
        ours = self.methods["ours"].mean_seconds
        for name in ("thesis", "greedy", "brute_force"):
            other = self.methods[name].mean_seconds
            yield f"ours takes {ours / other:.2f} of the time of {name}, 1 / {other / ours:.2f}"
        count = self.methods["ours"].queries
        yield f"ours takes more than three times as long as the thesis in {self.slower} of {count}"


def report(searched: Sequence[Searched], settings: TrialSettings) -> Report:
    """Scores of all that was searched, at least one query."""
    names = dict.fromkeys(name for one in searched for name in one.outcomes)
    scores = {name: _score(searched, name) for name in names}
    return Report(
        methods={name: scores[name] for name in METHODS},
        silent={name: scores[name] for name in ("nothing on the way", *SILENT)},
        parts={name: scores[name] for name in PARTS},
        robustness={
            n: s for n, s in scores.items() if n not in METHODS and n not in {*PARTS, *SILENT}
        },
        settings=settings,
        slower=sum(
            one.outcomes["ours"].seconds > 3 * one.outcomes["thesis"].seconds for one in searched
        ),
    )


def _score(searched: Sequence[Searched], name: str) -> Score:
    """Of the queries that were searched this way."""
    those = [one for one in searched if name in one.outcomes]
    return score([one.outcomes[name] for one in those], [one.shortest(name) for one in those])


def _plain(one: Score) -> dict[str, float | int | None]:
    return {k: v if v is None else round(v, 4) for k, v in asdict(one).items()}


def _settings(settings: TrialSettings) -> dict[str, object]:
    sensor, motion = asdict(settings.sensor), asdict(settings.motion)
    return {
        "sensor": sensor,
        "motion": motion,
        "rooms": settings.rooms.name if settings.rooms else None,
        "seed": settings.seed,
        "give_up_at": settings.give_up_at,
        "horizon_seconds": HORIZON,
    }
