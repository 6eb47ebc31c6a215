{%- for file in library -%}
pe_lib hdl/{{ file }}
{% endfor -%}
work {{ model }}_program_pkg.vhd
work {{ model }}.vhd
work {{ model }}_tb.vhd
{% if host -%}
work {{ model }}_host_tb.vhd
{% endif -%}
