"""How long work still takes, shown only where it is known within a factor of two."""

from __future__ import annotations

KNOWN_SHARE = 0.05
"""Share of the work before which nobody knows how long it takes."""

AGREED = 1.5
"""Ratio up to which estimates agree; with what none of them sees, the truth is then within a factor of two."""


class TimeLeft:
    """What is known of the time left from how far the work was at each moment, shares never falling.

    A time is shown while three estimates agree: by the pace from the beginning, by that of the last fifth of the time
    gone by, and what was predicted at every moment of its later half. After a change of pace nothing is shown until the
    new one has lasted.
    """

    def __init__(self, started_s: float) -> None:
        self._started_s = started_s
        self._seen: list[tuple[float, float]] = [(started_s, 0.0)]  # moment, share

    def seen(self, share: float, now_s: float) -> None:
        """Take note that a `share` of the work is done."""
        if share > self._seen[-1][1]:
            self._seen.append((now_s, share))

    def left_s(self, now_s: float) -> float | None:
        """Return the time left in seconds, None where it is not known within a factor of two."""
        gone_s, share = now_s - self._started_s, self._seen[-1][1]
        if share < KNOWN_SHARE or gone_s <= 0.0:
            return None
        before_s, before = next(one for one in reversed(self._seen) if one[0] <= now_s - 0.2 * gone_s)
        if not share > before:
            return None
        left_s = gone_s * (1.0 - share) / share
        others = [(1.0 - share) * (now_s - before_s) / (share - before)]
        for at_s, done in reversed(self._seen):
            if at_s < now_s - 0.5 * gone_s:
                break
            others.append(max((at_s - self._started_s) / done - gone_s, 0.0))
        agreed = all(left_s <= AGREED * other and other <= AGREED * left_s for other in others)
        return left_s if agreed else None
