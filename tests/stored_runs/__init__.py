"""Small runs of every version with another format since 0.11.1, and what these versions printed of them."""
