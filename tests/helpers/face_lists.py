"""Faces at random, which need not be those of any surface."""

import numpy as np
from hypothesis import strategies as st

random_faces = st.lists(st.tuples(*[st.integers(0, 14)] * 3), min_size=1, max_size=40).map(np.array)
