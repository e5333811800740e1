"""`make bench`: how fast the emulator is here, beside what the transports below it could do at best."""
