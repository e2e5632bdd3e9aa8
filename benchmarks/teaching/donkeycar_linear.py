"""The peer on real pictures: donkeycar's linear model, trained by donkeycar's own `train` with its own settings.

It runs in a Python of its own, as donkeycar wants an old TensorFlow, which `pictures.py` installs (see `PEER` there):

    python donkeycar_linear.py FOLDER TRAIN JUDGE SEED OUT.json

FOLDER holds records.jsonl and images/. TRAIN and JUDGE are ranges of its lines such as 0:500. OUT.json gets the model's
steering for each line of JUDGE, and how many parameters it has.
"""

import json
import random
import sys
import tempfile
from pathlib import Path

import donkeycar
import numpy as np
import tensorflow
from donkeycar.config import load_config
from donkeycar.parts.tub_v2 import Tub
from donkeycar.pipeline.training import train
from donkeycar.utils import get_model_by_type
from PIL import Image


def picture(folder: Path, record: dict) -> np.ndarray:
    """The picture of a record, in the model's size."""
    return np.asarray(Image.open(folder / "images" / record["image"]).convert("RGB").resize((160, 120)))


def main() -> None:
    """Write the records as a tub, train, and steer."""
    folder, out = Path(sys.argv[1]), Path(sys.argv[5])
    taught, judged = (slice(*map(int, word.split(":"))) for word in sys.argv[2:4])
    seed = int(sys.argv[4])
    random.seed(seed)
    np.random.seed(seed)
    tensorflow.random.set_seed(seed)
    records = [json.loads(line) for line in (folder / "records.jsonl").read_text().splitlines()]
    with tempfile.TemporaryDirectory() as made:
        there = Path(made)
        tub = Tub(
            str(there / "tub"),
            inputs=["cam/image_array", "user/angle", "user/throttle", "user/mode"],
            types=["image_array", "float", "float", "str"],
        )
        for each in records[taught]:
            tub.write_record(
                {
                    "cam/image_array": picture(folder, each),
                    "user/angle": each["steering"],
                    "user/throttle": each["throttle"],
                    "user/mode": "user",
                }
            )
        tub.close()
        (there / "models").mkdir()
        template = Path(donkeycar.__file__).parent / "templates" / "cfg_complete.py"
        (there / "config.py").write_text(template.read_text())
        config = load_config(str(there / "config.py"))
        # where it keeps things; everything else is donkeycar's own choice
        config.SHOW_PLOT, config.CREATE_TF_LITE, config.MODELS_PATH = False, False, str(there / "models")
        config.MODEL_PATH = str(there / "models")
        model_file = str(there / "models" / "linear.h5")
        train(config, str(there / "tub"), model_file, "linear")
        pilot = get_model_by_type("linear", config)
        pilot.load(model_file)
        steering = [float(pilot.run(picture(folder, each))[0]) for each in records[judged]]
    parameters = int(pilot.interpreter.model.count_params())
    versions = {"donkeycar": donkeycar.__version__, "tensorflow": tensorflow.__version__}
    out.write_text(json.dumps({"steering": steering, "parameters": parameters, **versions}))


if __name__ == "__main__":
    main()
