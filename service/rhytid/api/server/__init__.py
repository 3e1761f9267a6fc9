"""The server below the application: sockets, and what uvicorn makes of connections."""
