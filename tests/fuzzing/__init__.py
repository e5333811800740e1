"""What a peer, a file or a command line may hand in: valid messages, and what becomes of them on the way."""
