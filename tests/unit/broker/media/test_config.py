"""Media in broker.toml: what is wrong is named by file, line and key."""

import pytest

from swarmd.broker.config import Carries, Config
from swarmd.broker.sockets.udp import loopback_only
from swarmware.errors import ConfigError
from swarmware.model import config

SERIAL = '[[serial]]\nname = "modem"\ndevice = "/dev/ttyUSB0"\n'
NETWORK = '[[network]]\nname = "radio2"\ninterface = "wlan1"\n'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (SERIAL + "baud = 50\n", r"broker.toml: line 4: key serial\[0\]\.baud: .*>= 300.* \(it is 50\)"),
        (
            SERIAL + "bauds = 9600\n",
            r"broker.toml: line 4: key serial\[0\]\.bauds: unknown; did you mean baud",
        ),
        ('[[serial]]\nname = "modem"\n', r"key serial\[0\].*device"),
        (SERIAL + 'carries = "video"\n', r"line 4: key serial\[0\]\.carries: .*'video'"),
        (SERIAL + SERIAL, "media: the name 'modem' twice; expected one medium of each name"),
        (NETWORK.replace("radio2", "main"), "media: the name 'main' twice"),
        (NETWORK.replace("radio2", "Radio 2"), r"line 2: key network\[0\]\.name: .*regex"),
        (NETWORK + "udp_port = 0\n", r"line 4: key network\[0\]\.udp_port"),
    ],
)
def test_invalid_medium_is_named_with_file_and_key(text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        config.parse(text, Config, "broker.toml")


def test_media_have_defaults_and_stay_unused_without_keys() -> None:
    found = config.parse(SERIAL + NETWORK + 'carries = "payload"\n', Config, "broker.toml")
    assert (found.serial[0].baud, found.serial[0].carries) == (57_600, Carries.ALL)
    assert found.network[0].carries is Carries.PAYLOAD
    assert not loopback_only(found).serial
    assert not loopback_only(found).network
