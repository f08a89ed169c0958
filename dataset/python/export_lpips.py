"""Writes the network of LPIPS (Zhang et al. 2018) as the ONNX file that `compress evaluate` and `compress compare` take with `--lpips FILE`.

    pip install lpips torch torchvision onnx
    python export_lpips.py lpips-alex.onnx

The authors' package brings the weights of the last layers and fetches those of the network below (about 230 MB for alex).
"""

import argparse

import lpips
import torch

SIDE = 128  # texels along a tile


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", help="the file to write")
    parser.add_argument("--net", choices=["alex", "vgg", "squeeze"], default="alex")
    parser.add_argument("--random", action="store_true", help="random weights: to try the export without a download")
    a = parser.parse_args()
    torch.manual_seed(1)
    network = lpips.LPIPS(net=a.net, verbose=False, pnet_rand=a.random, pretrained=not a.random).eval()
    for layer in network.lins if a.random else []:
        for weights in layer.parameters():
            weights.data.abs_()  # as trained ones are: a distance is not negative
    image = torch.zeros(1, 3, SIDE, SIDE)
    torch.onnx.export(network, (image, image), a.out, input_names=["reference", "decoded"],
                      output_names=["distance"], opset_version=17, dynamo=False)


if __name__ == "__main__":
    main()
