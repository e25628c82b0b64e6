"""What the web server and its page cost."""
