from .adapters import open_adapter
def open_gpu():
    return open_adapter(software=True)
