"""Benchmarks: measured claims, each printed by one command."""
