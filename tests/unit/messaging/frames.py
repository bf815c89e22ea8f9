"""Frames of any content, for tests with whatever may come in."""

from collections.abc import Sequence

from hypothesis import strategies as st

from swarmware.model.frame import Codec, Frame, FrameKind
from swarmware.types import registry
from swarmware.types.rpc import Ack, Reply

_PAYLOADS = st.one_of(
    st.binary(max_size=40),
    st.builds(lambda s, w: registry.encode(Ack(s, w)), st.integers(-3, 9), st.text(max_size=5)),
    st.builds(lambda ok, body: registry.encode(Reply(ok, body)), st.booleans(), st.binary(max_size=5)),
)


def any_frames(data_ids: Sequence[int], ids: Sequence[int]) -> st.SearchStrategy[Frame]:
    """Frames of any kind with these data ids, and these ids of units and applications at both ends."""
    ends = st.sampled_from(ids)
    return st.builds(
        Frame,
        st.sampled_from(FrameKind),
        st.sampled_from(data_ids),
        ends,
        ends,
        ends,
        ends,
        sequence=st.integers(0, 3),
        stamp_ns=st.integers(-(2**63), 2**63 - 1),
        flags=st.integers(0, 15),
        codec=st.sampled_from(Codec),
        extension=st.binary(max_size=12),
        payload=_PAYLOADS,
    )
