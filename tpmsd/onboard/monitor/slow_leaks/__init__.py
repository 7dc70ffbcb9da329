"""Slow leaks: loss of radius over days."""
