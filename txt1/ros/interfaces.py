"""Makes ROS 2's types from definitions. It is run by a Python with ROS's generators, as in the wheels.

``python interfaces.py FOLDER PACKAGE...``: below FOLDER lie ``PACKAGE/msg/Name.msg``, ``srv/Name.srv``,
``action/Name.action``. Each package becomes a library and an extension module beside ROS's own, by gcc and g++ alone.
"""

import os
import subprocess
import sys
import sysconfig
from pathlib import Path
from typing import Final

KINDS: Final = ("msg", "srv", "action")
SUPPORTS: Final = ("rosidl_typesupport_fastrtps_c", "rosidl_typesupport_introspection_c")
"""Middleware support of a type: serialisation, and introspection of its fields."""


def make(folder: Path, package: str) -> None:
    """Generate, compile and install one package."""
    from rosidl_cli.command.hash.api import generate_type_hashes
    from rosidl_cli.command.translate.api import translate
    from rosidl_generator_c.cli import GenerateC
    from rosidl_generator_py.cli import GeneratePython
    from rosidl_typesupport_c.cli import GenerateCTypesupport
    from rosidl_typesupport_fastrtps_c.cli import GenerateFastRTPSCTypesupport
    from rosidl_typesupport_introspection_c.cli import GenerateIntrospectionCTypesupport

    prefix, site = Path(sys.prefix), Path(sysconfig.get_path("purelib"))
    share = prefix / "share"
    source = folder / package
    work = folder / "build" / package
    work.mkdir(parents=True, exist_ok=True)
    kinds = {kind: sorted(source.glob(f"{kind}/*.{kind}")) for kind in KINDS}
    files = [f"{source}:{path.relative_to(source)}" for paths in kinds.values() for path in paths]
    idl = translate(
        package_name=package,
        interface_files=files,
        include_paths=[str(share)],
        output_format="idl",
        output_path=work / "idl",
    )
    place = {"package_name": package, "interface_files": idl, "include_paths": [str(share)]}
    # each in a folder of its own, because some files have the same names
    c, fast, told, dispatch, python = (work / name / package for name in ("c", "fast", "told", "dispatch", "python"))
    hashes = generate_type_hashes(**place, output_path=c)
    GenerateC("c").generate(**place, output_path=c, type_description_files=hashes)
    GenerateFastRTPSCTypesupport("fastrtps_c").generate(**place, output_path=fast)
    GenerateIntrospectionCTypesupport("introspection_c").generate(**place, output_path=told)
    GenerateCTypesupport("c", typesupport_implementations=list(SUPPORTS)).generate(**place, output_path=dispatch)
    GeneratePython("py", typesupport_implementations=["rosidl_typesupport_c"]).generate(**place, output_path=python)
    _compile(package, [c, fast, told, dispatch, python], work, prefix, site)


def _compile(package: str, generated: list[Path], work: Path, prefix: Path, site: Path) -> None:
    target = site / package
    target.mkdir(exist_ok=True)
    for path in generated[-1].rglob("*.py"):
        place = target / path.relative_to(generated[-1])
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(path.read_bytes())
    sources = [path for folder in generated for path in sorted(folder.rglob("*.c*")) if path.suffix in (".c", ".cpp")]
    include = prefix / "include"
    numpy = site / "numpy" / "_core" / "include"
    includes = [
        *(folder.parent for folder in generated),
        include,
        sysconfig.get_path("include"),
        numpy,
        *sorted(path for path in include.iterdir() if path.is_dir()),
    ]
    flags = [f"-I{path}" for path in includes]
    # generators for Python, and all others
    objects: dict[bool, list[str]] = {True: [], False: []}
    for source in sources:
        language = ["gcc", "-std=gnu11"] if source.suffix == ".c" else ["g++", "-std=c++17"]
        name = str(work / f"{source.relative_to(work)}.o".replace("/", "_"))
        _run(*language, "-O1", "-fPIC", "-w", *flags, "-c", str(source), "-o", name)
        objects["_s.ep." in source.name or source.name.endswith("_s.c")].append(name)
    library = prefix / "lib"
    names = (
        "lib*__rosidl_generator_c.so",
        "lib*__rosidl_typesupport_*c.so",
        "librosidl_*.so",
        "librcutils.so",
        "libfastcdr.so",
    )
    others = [str(path) for name in names for path in sorted(library.glob(name)) if f"lib{package}__" not in path.name]
    whole = library / f"lib{package}__{SUPPORTS[0]}.so"
    link = ["g++", "-shared", "-Wl,--as-needed", f"-Wl,-rpath,{library}"]
    _run(*link, "-o", str(whole), *objects[False], *others)
    # names by which they are found
    for same in (SUPPORTS[1], "rosidl_typesupport_c", "rosidl_generator_c"):
        alias = library / f"lib{package}__{same}.so"
        alias.unlink(missing_ok=True)
        alias.symlink_to(whole.name)
    extension = target / f"{package}_s__rosidl_typesupport_c{sysconfig.get_config_var('EXT_SUFFIX')}"
    converters = [str(path) for path in sorted(library.glob("lib*__rosidl_generator_py.so"))]
    _run(*link, "-o", str(extension), *objects[True], str(whole), *others, *converters)


def _run(*words: str) -> None:
    done = subprocess.run(words, capture_output=True, text=True, check=False)  # noqa: S603
    if done.returncode != 0:
        sys.exit(f"{' '.join(words[:1])}: {done.stderr.strip()[-2000:]}")


if __name__ == "__main__":
    os.environ["AMENT_PREFIX_PATH"] = sys.prefix
    for name in sys.argv[2:]:
        make(Path(sys.argv[1]).resolve(), name)
