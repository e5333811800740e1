"""Chaos: what people, machines and strangers do to runs of real processes, and what must hold nevertheless."""
