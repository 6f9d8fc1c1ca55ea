"""Makes the policies of this folder, and what the libraries that trained them calculate.

    python make.py FOLDER     (needs: torch onnx onnxscript scikit-learn skl2onnx)

NAME.onnx is what an exporter wrote, NAME.npy (1000, outputs) float32 what the library itself gives
for the `observations`, step after step, with the state of the step before.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

STEPS = 1000
LIBRARIES = ("torch", "onnx", "onnxscript", "sklearn", "skl2onnx")
SKLEARN = ("sklearn_tanh", "sklearn_relu", "sklearn_logistic")
TORCH = ("mlp", "mlp_script", "critic", "gru", "gru_layers", "gru_cell", "gru_alone", "delay")


def observations(width: int) -> Any:
    """(1000, width) float32 in -2..2, the same on every machine: whole numbers, divided by 500."""
    step, number = np.mgrid[:STEPS, :width].astype(np.int64)
    mixed = (step * 7919 + number * 104729 + step * step * 31 + number * step * 127) % 2001
    return ((mixed - 1000) / np.float32(500)).astype(np.float32)


def sklearn(name: str) -> tuple[bytes, Any]:
    from skl2onnx import to_onnx
    from sklearn.neural_network import MLPRegressor
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import MinMaxScaler, StandardScaler

    seen = observations(6)
    wanted = np.tanh(seen @ np.linspace(-1, 1, 12).reshape(6, 2))
    activation = name.removeprefix("sklearn_")
    scaler = MinMaxScaler() if activation == "relu" else StandardScaler()
    layers = {"hidden_layer_sizes": (6, 5), "activation": activation}
    net = make_pipeline(scaler, MLPRegressor(**layers, max_iter=200, random_state=1))
    net.fit(seen, wanted)
    return to_onnx(net, seen[:1]).SerializeToString(), net.predict(seen)


def torch_net(name: str) -> Any:
    """A network; of some the state goes in and comes out."""
    import torch
    from torch import nn

    torch.manual_seed(1)

    class Perceptron(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            sizes, parts = (8, 6, 5, 4), []
            for inputs, outputs, after in zip(sizes, sizes[1:], (nn.Tanh, nn.ReLU, nn.Sigmoid)):
                parts += [nn.Linear(inputs, outputs), after()]
            self.net, self.last = nn.Sequential(*parts), nn.Linear(4, 2)
            self.register_buffer("mean", torch.linspace(-0.3, 0.5, 8))
            self.register_buffer("std", torch.linspace(0.6, 1.4, 8))

        def forward(self, seen: Any) -> Any:
            inner = self.net((seen - self.mean) / self.std)
            action = self.last(inner).clamp(-0.25, 1.0)
            if name == "critic":
                return action, torch.exp(self.last(inner)), torch.log(inner)
            return action

    class Recurrent(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            size, layers = (16, 1) if name == "gru" else (4, 2 if name == "gru_layers" else 1)
            self.gru = nn.GRUCell(8, 4) if name == "gru_cell" else nn.GRU(8, size, layers)
            self.last = nn.Linear(size, 2)

        def forward(self, seen: Any, state: Any = None) -> Any:
            if name == "gru_cell":
                state = self.gru(seen, state)
                return torch.tanh(self.last(state)), state
            if name == "gru_alone":
                return torch.tanh(self.last(self.gru(seen)[0][-1]))
            out, state = self.gru(seen.unsqueeze(0), state)
            return torch.tanh(self.last(out.squeeze(0))), state

    class Delay(nn.Module):
        def forward(self, seen: Any, state: Any) -> Any:
            return state[:, 1:3], torch.cat((seen[:, 5:7], state[:, :2]), 1)

    if name == "delay":
        return Delay()
    return Recurrent() if name.startswith("gru") else Perceptron()


def torch_policy(name: str, file: Path) -> Any:
    """Writes the file with PyTorch's exporters, old and new; gives what PyTorch calculates."""
    import torch

    net, seen = torch_net(name).eval(), torch.tensor(observations(8))
    dynamo = name in ("mlp", "gru")
    how = {"dynamo": True, "external_data": False} if dynamo else {"dynamo": False}
    states = {"gru": (1, 1, 16), "gru_layers": (2, 1, 4), "gru_cell": (1, 4), "delay": (1, 4)}
    with torch.no_grad():
        if name in states:
            state, rows = torch.zeros(states[name]), []
            torch.onnx.export(net, (seen[:1], state), file, **how)
            for row in seen.unsqueeze(1):
                action, state = net(row, state)
                rows.append(action[0])
            return torch.stack(rows).numpy()
        if name == "gru_alone":
            axes = {"input_names": ["seen"], "dynamic_axes": {"seen": {1: "robots"}}}
            torch.onnx.export(net, (seen[:1].unsqueeze(0),), file, **how, **axes)
            out, _ = net.gru(seen.unsqueeze(1))
            return torch.tanh(net.last(out[:, 0])).numpy()
        axes = {"input_names": ["seen"], "dynamic_axes": {"seen": {0: "robots"}}}
        torch.onnx.export(net, (seen[:1],), file, **how, **({} if dynamo else axes))
        result = net(seen)
        return (result if isinstance(result, torch.Tensor) else result[0]).numpy()


def make(folder: Path) -> None:
    """Makes all of them."""
    for name in SKLEARN:
        data, results = sklearn(name)
        (folder / f"{name}.onnx").write_bytes(data)
        np.save(folder / f"{name}.npy", results.astype(np.float32))
    for name in TORCH:
        results = torch_policy(name, folder / f"{name}.onnx")
        np.save(folder / f"{name}.npy", results.astype(np.float32))


if __name__ == "__main__":
    make(Path(sys.argv[1]))
