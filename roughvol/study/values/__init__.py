"""Values of a study: numbers with units, levels of a state, and words in place of values."""
