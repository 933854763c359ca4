"""What arrives and leaves: messages, pairing of topics, playing and recording."""
