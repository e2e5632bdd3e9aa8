"""Whatever a peer, a page or a bridge may say: any value that JSON has, and numbers that Python's has besides."""

from __future__ import annotations

from hypothesis import strategies as st

JSON = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=8)
    | st.sampled_from([10**400, -(10**400), 1e308, 2**60, "1e999", "nan", "\x1b[2J", [], {}]),
    lambda inner: st.lists(inner, max_size=20) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=20,
)
