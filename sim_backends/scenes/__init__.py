"""Generated scenes: buildings with many alike windows, and the model bases made of them."""
