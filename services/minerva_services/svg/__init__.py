"""Pictures of a world as SVG and PNG files, drawn from the forms of its vocabulary."""

from minerva_services.svg.service import Svg

__all__ = ["Svg"]
