import asyncio

from robot.clock import run_virtual
from robot.events import Bus


def test_a_lossless_listener_gets_every_event_in_order_and_a_newest_only_one_the_last():
    async def main():
        bus = Bus()
        every, newest = bus.subscribe(int), bus.subscribe(int, newest_only=True)
        for number in range(5):
            bus.publish(number)
        bus.publish("not a number")
        return every.drain(), newest.drain()

    assert run_virtual(main()) == ([0, 1, 2, 3, 4], [4])


def test_a_waiting_listener_wakes_up_with_the_event():
    async def main():
        bus = Bus()
        heard = bus.subscribe(str)
        waiting = asyncio.create_task(heard.next())
        await asyncio.sleep(1.0)
        bus.publish("shot")
        return await waiting

    assert run_virtual(main()) == "shot"


def test_a_listener_that_left_hears_nothing():
    async def main():
        bus = Bus()
        heard = bus.subscribe(str)
        bus.unsubscribe(heard)
        bus.publish("shot")
        return heard.drain()

    assert run_virtual(main()) == []
