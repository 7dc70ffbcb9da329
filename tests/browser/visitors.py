"""Many browsers that look on: `python -m tests.browser.visitors PORT CLIENTS SECONDS`.

In: the port of `tpmsd web`. Out: `CONNECTED` once all have their first answer, and at the end `UPDATES` with
how many each got. One more client asks and never reads. A process of its own at the lowest priority: true
browsers are on other machines and take nothing from the daemon's.
"""

from __future__ import annotations

import asyncio
import os
import sys


async def look_on(port: int, clients: int, seconds: float) -> list[int]:
    """Updates of each client."""
    idle, writer = await asyncio.open_connection("127.0.0.1", port, limit=1024)
    writer.write(request(port))
    barrier = asyncio.Barrier(clients)
    counts = await asyncio.gather(*(_client(port, seconds, barrier) for _ in range(clients)))
    writer.close()
    del idle
    return counts


async def _client(port: int, seconds: float, together: asyncio.Barrier) -> int:
    reader, writer = await asyncio.open_connection("127.0.0.1", port, limit=1 << 22)
    writer.write(request(port))
    await reader.readuntil(b"event: ")
    if await together.wait() == 0:
        print("CONNECTED", flush=True)
    count = 0
    try:
        async with asyncio.timeout(seconds):
            while line := await reader.readline():
                count += line == b"event: status\n"
    except TimeoutError:
        pass
    writer.close()
    return count


def request(port: int) -> bytes:
    """What a browser asks for."""
    return f"GET /api/live HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode()


if __name__ == "__main__":
    os.nice(19)
    port, clients, seconds = sys.argv[1:]
    print("UPDATES", *asyncio.run(look_on(int(port), int(clients), float(seconds))), flush=True)
