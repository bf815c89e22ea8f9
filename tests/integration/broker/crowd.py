"""Opens connections from several addresses behind the firewall rules of a file; prints how many."""

import json
import socket
import subprocess
import sys
from contextlib import ExitStack

PORT = 7448


def connected(address: str, count: int, kept: ExitStack) -> int:
    """Number of accepted connections, of a number attempted from one address."""
    found = 0
    for _ in range(count):
        client = kept.enter_context(socket.socket())
        client.bind((address, 0))
        client.settimeout(0.05)
        try:
            client.connect(("127.0.0.1", PORT))
        except TimeoutError:
            continue
        found += 1
    return found


def main() -> None:
    """Runs in a network namespace of its own."""
    subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
    subprocess.run(["nft", "-f", sys.argv[1]], check=True)
    with ExitStack() as kept:
        kept.enter_context(socket.create_server(("0.0.0.0", PORT), backlog=200))
        crowd = connected("127.0.0.2", 40, kept)
        other = connected("127.0.0.3", 5, kept)
    sys.stdout.write(json.dumps({"crowd": crowd, "other": other}))


if __name__ == "__main__":
    main()
