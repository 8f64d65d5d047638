"""The moment of an epoch in our own clock, from when its sentences came in."""

from __future__ import annotations

from collections import deque

from drivers.gps.epochs import DAY_S

WINDOW_S = 20.0  # clocks drift apart by 1 ms at the most meanwhile
STEP_S = 2.5  # sentences that are later than this have not been delayed: the receiver's clock was set


class EpochMoments:
    """Takes the jitter of the way out of arrival times.

    A sentence can be late and never early, and the receiver's own time tells how far apart its epochs are: of the last
    ``WINDOW_S`` the epoch that came earliest counts. Sentences that come late so keep the stamp of their epoch.
    ``output_delay_s`` is from an epoch to the first bit of its sentences.
    """

    def __init__(self, output_delay_s: float) -> None:
        self._output_delay_s = output_delay_s
        self._lags: deque[tuple[float, float]] = deque(maxlen=1000)  # when, our clock minus the receiver's

    def moment_s(self, began_s: float, day_s: float | None) -> float:
        """The epoch whose sentences began at ``began_s``; ``day_s`` is the receiver's time of it, if it tells one."""
        at_s = began_s - self._output_delay_s
        if day_s is None:
            return at_s
        lag_s = at_s - day_s
        if self._lags:
            lag_s += DAY_S * round((self._lags[-1][1] - lag_s) / DAY_S)
        while self._lags and self._lags[0][0] < at_s - WINDOW_S:
            self._lags.popleft()
        least_s = min((lag for _, lag in self._lags), default=lag_s)
        if lag_s > least_s + STEP_S or lag_s < least_s - STEP_S:
            self._lags.clear()
            least_s = lag_s
        self._lags.append((at_s, lag_s))
        return at_s - (lag_s - min(least_s, lag_s))
