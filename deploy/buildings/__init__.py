"""What policies are worth on plans like real buildings: the table of the study `buildings`, claims, and its page."""
