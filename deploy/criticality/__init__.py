"""Which robot can a mission not afford to lose, and when? Every single failure, each in a branch of its own."""
