"""Values of a study: numbers with units, states of a sweep, words in place of values."""
