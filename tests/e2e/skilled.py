"""A learner that finds the light from its first episode on, and goes on learning."""

import numpy as np

from txt1.config import Config
from txt1.learning.agent import Agent
from txt1.learning.registry import make
from txt1.learning.thesis import TABLE_5_3

EPISODES = 40
"""After as many the thesis's learner explores next to nothing."""


def skilled(config: Config, seed: int = 1) -> Agent:
    """Return the thesis's learner with what its robot had learned (table 5.3)."""
    agent = make("thesis", config, np.random.default_rng(seed))
    agent.recall({**agent.memory(), "q": TABLE_5_3, "episode": EPISODES})
    return agent
