"""One run as real processes: who starts them, what each runs, where it runs, and how the operator speaks to them."""
