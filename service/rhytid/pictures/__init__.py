"""Pictures of faces, stretch and skin, drawn from plain arrays with numpy and Pillow."""
