"""Pairs out of what two free cameras give, by the times of their frames."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from drivers.camera.grabber import Grab
from drivers.camera.pictures import Bytes

_KEPT = 4
_REMEMBERED = 60
_JUDGED_FROM = 20
DROPPED_SHARE_LIMIT = 0.10  # more dropped frames than that are a fault


@dataclass(frozen=True, slots=True, eq=False)
class GrabPair:
    """Two frames of one moment; of a side-by-side camera ``right`` is None and ``left`` holds both views."""

    left: Grab[Bytes]
    right: Grab[Bytes] | None = None

    @property
    def grab_s(self) -> float:
        """The earlier of both, in loop time: nothing in the pair was exposed later than it says."""
        return self.left.grab_s if self.right is None else min(self.left.grab_s, self.right.grab_s)


class Pairing:
    """``apart_s`` is how far apart the frames of a pair may come; what finds no partner is dropped and counted."""

    def __init__(self, apart_s: float) -> None:
        self._apart_s = apart_s
        self._waiting: tuple[deque[Grab[Bytes]], deque[Grab[Bytes]]] = (deque(), deque())
        self._fates: deque[bool] = deque(maxlen=_REMEMBERED)
        self.dropped = 0
        self.nearest_miss_s = float("inf")

    def add(self, side: int, grab: Grab[Bytes]) -> GrabPair | None:
        """Frame of the left (0) or right (1) camera; the pair that it completes."""
        own, other = self._waiting[side], self._waiting[1 - side]
        partner = min(other, key=lambda kept: abs(kept.grab_s - grab.grab_s), default=None)
        if partner is not None:
            gap_s = abs(partner.grab_s - grab.grab_s)
            if gap_s <= self._apart_s:
                while other[0] is not partner:
                    self._drop(other)
                other.popleft()
                while own:
                    self._drop(own)
                self._fates.append(True)
                return GrabPair(grab, partner) if side == 0 else GrabPair(partner, grab)
            self.nearest_miss_s = gap_s
        own.append(grab)
        while len(own) > _KEPT:
            self._drop(own)
        return None

    def forget(self) -> None:
        """The cameras begin anew."""
        for kept in self._waiting:
            kept.clear()
        self._fates.clear()

    @property
    def falls_apart(self) -> bool:
        """Whether more than a tenth of the last frames found no partner."""
        missed = self._fates.count(False)
        return len(self._fates) >= _JUDGED_FROM and missed > DROPPED_SHARE_LIMIT * len(self._fates)

    def _drop(self, kept: deque[Grab[Bytes]]) -> None:
        kept.popleft()
        self._fates.append(False)
        self.dropped += 1
