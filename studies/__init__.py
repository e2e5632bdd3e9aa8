"""Studies that a paper needs and a robot does without: no wheel has them, and txt1 imports nothing of theirs."""
