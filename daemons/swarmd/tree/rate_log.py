"""Records of streams that their link limits: when it begins, and when it ends."""

import logging
from collections.abc import Mapping

log = logging.getLogger("swarm.tree")


class RateLog:
    """Compares the streams that are limited with those of the last look."""

    def __init__(self) -> None:
        self._limited: frozenset[tuple[str, str]] = frozenset()
        """Path and subscriber."""

    def record(self, limited: Mapping[tuple[str, str], tuple[float, str]]) -> None:
        """The streams that are limited now, by path and subscriber: the rate in Hz and the reason."""
        for path, platform in sorted(self._limited.difference(limited)):
            log.info("%s to %s: the link carries all of it again, or its rate is set", path, platform)
        for (path, platform), (rate_hz, reason) in limited.items():
            if (path, platform) not in self._limited:
                log.info("%s to %s: the link carries %.1f/s (%s)", path, platform, rate_hz, reason)
        self._limited = frozenset(limited)
