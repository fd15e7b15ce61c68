"""Curves -> exponents with statistical and systematic errors."""
