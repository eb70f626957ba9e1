"""Values of a study: numbers with units, levels of a state, words in place of values, times as text."""
