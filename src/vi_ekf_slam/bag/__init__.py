"""Bags: what their messages are, reading, writing and converting to them."""
