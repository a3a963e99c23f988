"""Beside a running node: its load test, the recorder of its outputs, a master of one's own."""
