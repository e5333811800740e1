"""`make bench`: the speed of the emulator on this machine, beside the best that transports below it reach."""
