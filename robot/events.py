"""The typed in-process bus: publishers do not know their listeners and are never held up by them."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import AsyncIterator
from typing import Any, Generic, TypeVar

E = TypeVar("E")


class Subscription(Generic[E]):
    """The events of some types, in order, since it was made. ``newest_only`` keeps just the last unread one."""

    def __init__(self, kinds: tuple[type[E], ...], newest_only: bool) -> None:
        self._kinds = kinds
        self._unread: deque[E] = deque(maxlen=1 if newest_only else None)
        self._arrived = asyncio.Event()

    def offer(self, event: Any) -> None:
        if isinstance(event, self._kinds):
            self._unread.append(event)
            self._arrived.set()

    async def next(self) -> E:
        while not self._unread:
            self._arrived.clear()
            await self._arrived.wait()
        return self._unread.popleft()

    def drain(self) -> list[E]:
        """Everything that is unread, without waiting."""
        events = list(self._unread)
        self._unread.clear()
        return events

    async def __aiter__(self) -> AsyncIterator[E]:
        while True:
            yield await self.next()


class Bus:
    """Hands each published event to every subscription of its type."""

    def __init__(self) -> None:
        self._subscriptions: list[Subscription[Any]] = []

    def subscribe(self, *kinds: type[E], newest_only: bool = False) -> Subscription[E]:
        subscription = Subscription(kinds, newest_only)
        self._subscriptions.append(subscription)
        return subscription

    def unsubscribe(self, subscription: Subscription[Any]) -> None:
        self._subscriptions.remove(subscription)

    def publish(self, event: object) -> None:
        for subscription in self._subscriptions:
            subscription.offer(event)
