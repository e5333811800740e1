"""How the processes talk and keep step: session, keys, codec, lockstep."""
