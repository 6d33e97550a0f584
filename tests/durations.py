"""How long tests take: ``--durations-json FILE`` writes it for every test, and lists the slowest files."""

import json
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

SLOWEST = 20
"""Number of files that are listed."""

BY_FILE = "puppetline/seconds"
"""Key in pytest's cache of the seconds that each file has taken when it was last run."""


class Durations:
    """Adds up the seconds of each test's setup, call and teardown."""

    def __init__(self, config: pytest.Config) -> None:
        self._config = config
        self._tests: dict[str, dict[str, Any]] = {}

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        test = self._tests.setdefault(report.nodeid, {"nodeid": report.nodeid, "outcome": "passed"})
        test[report.when] = round(report.duration, 4)
        if not report.passed:
            test["outcome"] = report.outcome

    def _by_file(self) -> Counter[str]:
        seconds: Counter[str] = Counter()
        for nodeid, test in self._tests.items():
            seconds[nodeid.partition("::")[0]] += sum(test.get(when, 0) for when in ("setup", "call", "teardown"))
        return seconds

    def pytest_sessionfinish(self) -> None:
        if hasattr(self._config, "cache"):
            self._config.cache.set(BY_FILE, {**self._config.cache.get(BY_FILE, {}), **self._by_file()})
        if file := self._config.option.durations_json:
            Path(file).parent.mkdir(parents=True, exist_ok=True)
            Path(file).write_text(json.dumps([*self._tests.values()], indent=0), encoding="utf-8")

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        if self._config.option.durations_json:
            seconds = self._by_file()
            total = seconds.total() or 1
            terminalreporter.section(f"slowest files of {len(seconds)}, {total:.0f} s in all")
            for file, spent in seconds.most_common(SLOWEST):
                terminalreporter.line(f"{spent:7.1f} s {spent / total:6.1%}  {file}")
