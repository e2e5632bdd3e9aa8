from glob import glob

from setuptools import setup

setup(
    name="txt1_bringup",
    version="0.1.0",
    packages=[],
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/txt1_bringup"]),
        ("share/txt1_bringup", ["package.xml"]),
        ("share/txt1_bringup/launch", glob("launch/*.py")),
        ("share/txt1_bringup/config", glob("config/*.yaml")),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
)
