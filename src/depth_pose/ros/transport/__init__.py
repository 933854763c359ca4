"""Transport of messages: subscriptions, pairing of topics, transforms, markers."""
