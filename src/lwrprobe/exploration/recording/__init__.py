"""What a run leaves behind: contacts, path, log, summary."""
