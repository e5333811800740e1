"""One run as real processes: what each runs, on which processor, who starts and watches them, who gives orders."""
