"""The event loop without OpenSSL, in interpreters of their own."""

import subprocess
import sys


def result(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout.strip()


IMPORT = """
import sys
from swarmware.footprint.event_loop import import_without_tls
import_without_tls("uvloop")
"""


def test_event_loop_is_imported_without_openssl_and_runs() -> None:
    code = (
        "import asyncio, uvloop\n"
        "async def main():\n"
        "    server = await asyncio.start_server(lambda r, w: w.close(), '127.0.0.1', 0)\n"
        "    reader, writer = await asyncio.open_connection(*server.sockets[0].getsockname())\n"
        "    assert await reader.read() == b''\n"
        "    writer.close(); server.close()\n"
        "uvloop.run(main()); asyncio.run(main())\n"
        "print('_ssl' in sys.modules, 'ssl' in sys.modules)"
    )
    assert result(IMPORT + code) == "False False"


def test_ssl_itself_can_be_used_afterwards() -> None:
    assert result(IMPORT + "import ssl; print(ssl.create_default_context().check_hostname)") == "True"


def test_a_stream_with_tls_says_why_it_fails() -> None:
    code = (
        "import asyncio, ssl, uvloop\nfrom swarmware.errors import SwarmError\n"
        "async def main():\n"
        "    try: await asyncio.start_server(print, '127.0.0.1', 0, ssl=ssl.create_default_context())\n"
        "    except SwarmError as error: print(error)\n"
        "uvloop.run(main())"
    )
    assert "imported its event loop without TLS" in result(IMPORT + code)


def test_process_that_has_imported_ssl_keeps_its_tls() -> None:
    code = (
        "import ssl\n" + IMPORT + "import asyncio, uvloop\n"
        "async def main():\n"
        "    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)\n"
        "    server = await asyncio.start_server(print, '127.0.0.1', 0, ssl=context)\n"
        "    server.close(); print('served')\n"
        "uvloop.run(main())"
    )
    assert result(code) == "served"


def test_asyncio_is_imported_without_openssl_and_uvloop() -> None:
    code = (
        "import asyncio\nasyncio.run(asyncio.sleep(0))\nprint('_ssl' in sys.modules, 'uvloop' in sys.modules)"
    )
    assert result(IMPORT.replace("uvloop", "asyncio") + code) == "False False"
