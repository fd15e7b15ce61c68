"""One question answered end to end: the tables of the paper, one map by every measure."""
