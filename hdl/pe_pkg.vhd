-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;
  use ieee.numeric_std.all;

-- Types, control-word layout, latency table and trace format; see docs/hardware.md.

package pe_pkg is

  type natural_array_t is array (natural range <>) of natural;

  -- Control words, memory images: element width as declared by the constant.
  type word_array_t is array (natural range <>) of std_ulogic_vector;

  -- Control word --------------------------------------------------------------------------------------------------

  -- Position of one field; absent fields have width 0.
  type field_t is record
    lsb   : natural;
    width : natural;
  end record field_t;

  -- A memory address field with its enable, swap and ring bits.
  type address_field_t is record
    enable  : field_t;
    swap    : field_t;
    ring    : field_t;
    address : field_t;
  end record address_field_t;

  type layout_t is record
    own                 : address_field_t;
    imported            : address_field_t;
    coefficient         : field_t;
    coefficient_address : field_t;
    close               : field_t;
    base                : address_field_t;
    index               : address_field_t;
    shift               : field_t;
    write_own           : field_t;
    write_base          : field_t;
    write_factor        : field_t;
    write               : address_field_t;
    write_index         : field_t;
    write_octave        : field_t;
    write_index_address : field_t;
    show                : field_t;
    send                : field_t;
    receive             : address_field_t;
    port_index          : field_t;
    bits                : natural;
  end record layout_t;

  -- Bits that count `count` things: ceil(log2 count).

  function index_bits (
    count : natural
  ) return natural;

  -- The layout of the control words of a PE with these features.

  function control_layout (
    own_words         : natural;
    base_words        : natural;
    coefficient_words : natural;
    imported_words    : natural;
    port_count        : natural;
    shift_count       : natural;
    coefficient_bits  : natural;
    factor            : boolean;
    swap              : boolean;
    send              : boolean;
    index_words       : natural;
    octaves           : boolean;
    show              : boolean := false;
    ring              : boolean := false
  ) return layout_t;

  -- Value of a one-bit field; '0' if the PE does not have it.

  function flag (
    control : std_ulogic_vector;
    field   : field_t
  ) return std_ulogic;

  -- Value of a field that may be absent: `width` bits, 0 if the PE does not have it.

  function bits (
    control : std_ulogic_vector;
    field   : field_t;
    width   : positive
  ) return std_ulogic_vector;

  -- Words that a write address tells apart.

  function write_words (
    own_words         : natural;
    base_words        : natural;
    coefficient_words : natural;
    factor            : boolean
  ) return natural;

  -- A control word from its parts: bits whose mask is '1' come from `streamed`, the others from `repeated`, lowest
  -- first.

  function merged (
    mask     : std_ulogic_vector;
    repeated : std_ulogic_vector;
    streamed : std_ulogic_vector
  ) return std_ulogic_vector;

  -- Address of a memory access; a set swap bit inverts the top bit in odd rounds.

  function steered (
    control : std_ulogic_vector;
    field   : address_field_t;
    width   : positive;
    parity  : std_ulogic
  ) return std_ulogic_vector;

  -- Selection -----------------------------------------------------------------------------------------------------

  -- Slice `index` of `entries`, which holds slices of `width` bits, slice 0 rightmost; 0 for one that does not
  -- exist. Four slices fill a six-input lookup table as a sum of products (as multiplexers of two, equal shift
  -- distances tempt synthesis into sharing halves); what groups of four give is chosen in the same way.

  function chosen (
    entries : std_ulogic_vector;
    index   : std_ulogic_vector;
    width   : positive
  ) return std_ulogic_vector;

  function larger (
    a : integer;
    b : integer
  ) return integer;

  function smallest (
    values : natural_array_t
  ) return natural;

  -- Latency, in control words -------------------------------------------------------------------------------------

  -- Cycles from operands to product register: 1 for a single 25x18 multiplier block, else 3.

  function multiplier_latency (
    data_bits        : positive;
    coefficient_bits : positive
  ) return positive;

  -- The network waits before this word; every write of the previous step has been done then.

  function pause_word (
    latency : positive;
    deep    : boolean := false
  ) return positive;

  -- Trace ---------------------------------------------------------------------------------------------------------

  -- Fields of one PE by their lowest bits: value (sign extended), address and enable of the write to the imported memory
  -- (its address without the own depth), the same of the own write, sticky overflow. PE p starts at bit p * TRACE_BITS;
  -- the topmost bit of the network's trace is 1 in the clocks in which a word is executed.
  constant TRACE_VALUE_BITS       : positive := 64;
  constant TRACE_ADDRESS_BITS     : positive := 16;
  constant TRACE_IMPORTED_VALUE   : natural  := 0;
  constant TRACE_IMPORTED_ADDRESS : natural  := TRACE_IMPORTED_VALUE + TRACE_VALUE_BITS;
  constant TRACE_IMPORTED_WRITE   : natural  := TRACE_IMPORTED_ADDRESS + TRACE_ADDRESS_BITS;
  constant TRACE_OWN_VALUE        : natural  := TRACE_IMPORTED_WRITE + 1;
  constant TRACE_OWN_ADDRESS      : natural  := TRACE_OWN_VALUE + TRACE_VALUE_BITS;
  constant TRACE_OWN_WRITE        : natural  := TRACE_OWN_ADDRESS + TRACE_ADDRESS_BITS;
  constant TRACE_OVERFLOW         : natural  := TRACE_OWN_WRITE + 1;
  constant TRACE_BITS             : positive := TRACE_OVERFLOW + 1;

  -- Width of the trace port of a network: one bit unless tracing.

  function trace_width (
    trace : boolean;
    pes   : positive
  ) return positive;

end package pe_pkg;

package body pe_pkg is

  function index_bits (
    count : natural
  ) return natural is

    variable width : natural;

  begin

    width := 0;
    while 2 ** width < count loop
      width := width + 1;
    end loop;
    return width;

  end function index_bits;

  function control_layout (
    own_words         : natural;
    base_words        : natural;
    coefficient_words : natural;
    imported_words    : natural;
    port_count        : natural;
    shift_count       : natural;
    coefficient_bits  : natural;
    factor            : boolean;
    swap              : boolean;
    send              : boolean;
    index_words       : natural;
    octaves           : boolean;
    show              : boolean := false;
    ring              : boolean := false
  ) return layout_t is

    variable layout      : layout_t;
    variable position    : natural;
    variable own_bits    : natural;
    variable import_bits : natural;
    variable import_flag : natural;
    variable stored_flag : natural;
    variable factor_flag : natural;
    variable swap_flag   : natural;
    variable send_flag   : natural;
    variable index_flag  : natural;
    variable octave_flag : natural;
    variable show_flag   : natural;
    variable ring_flag   : natural;

    -- Fields are placed from the least significant end.

    procedure place (
      variable field : out field_t;
      constant width : in  natural
    ) is
    begin

      field.lsb   := position;
      field.width := width;
      position    := position + width;

    end procedure place;

    procedure place_address (
      variable field       : out address_field_t;
      constant flags       : in  natural;
      constant swap_width  : in  natural;
      constant ring_width  : in  natural;
      constant index_width : in  natural
    ) is
    begin

      place(field.address, flags * index_width);
      place(field.ring, flags * ring_width);
      place(field.swap, flags * swap_width);
      place(field.enable, flags);

    end procedure place_address;

  begin

    own_bits    := index_bits(own_words);
    import_bits := index_bits(imported_words);
    import_flag := 0;
    stored_flag := 0;
    factor_flag := 0;
    swap_flag   := 0;
    send_flag   := 0;
    index_flag  := 0;
    octave_flag := 0;
    show_flag   := 0;
    ring_flag   := 0;

    if (imported_words > 0) then
      import_flag := 1;
    end if;

    if (coefficient_words > 0) then
      stored_flag := 1;
    end if;

    if (factor) then
      factor_flag := 1;
    end if;

    if (swap) then
      swap_flag := 1;
    end if;

    if (send) then
      send_flag := 1;
    end if;

    if (index_words > 0) then
      index_flag := 1;
    end if;

    if (index_words > 0 and octaves) then
      octave_flag := 1;
    end if;

    if (show) then
      show_flag := 1;
    end if;

    if (ring) then
      ring_flag := 1;
    end if;

    position    := 0;
    place(layout.port_index, index_bits(port_count));
    place_address(layout.receive, import_flag, swap_flag, ring_flag, import_bits);
    place(layout.send, send_flag);
    place(layout.show, show_flag);
    place(layout.write_index_address, index_bits(index_words));
    place(layout.write_octave, octave_flag);
    place(layout.write_index, index_flag);
    place(layout.write.address, index_bits(write_words(own_words, base_words, coefficient_words, factor)));
    place(layout.write.ring, ring_flag);
    place(layout.write.swap, swap_flag);
    place(layout.write.enable, 0);
    place(layout.write_factor, factor_flag);
    place(layout.write_base, 1);
    place(layout.write_own, 1);
    place(layout.shift, index_bits(shift_count));
    place_address(layout.index, index_flag, 0, 0, index_bits(index_words));
    place_address(layout.base, 1, 0, 0, index_bits(base_words));
    place(layout.close, 1);
    place(layout.coefficient_address, stored_flag * index_bits(coefficient_words));
    place(layout.coefficient, (1 - stored_flag) * coefficient_bits);
    place_address(layout.imported, import_flag, swap_flag, ring_flag, import_bits);
    place_address(layout.own, 1, swap_flag, ring_flag, own_bits);
    layout.bits := position;
    return layout;

  end function control_layout;

  function write_words (
    own_words         : natural;
    base_words        : natural;
    coefficient_words : natural;
    factor            : boolean
  ) return natural is
  begin

    if (factor) then
      return larger(larger(own_words, base_words), coefficient_words);
    end if;

    return larger(own_words, base_words);

  end function write_words;

  function flag (
    control : std_ulogic_vector;
    field   : field_t
  ) return std_ulogic is
  begin

    if (field.width = 0) then
      return '0';
    end if;

    return control(field.lsb);

  end function flag;

  function bits (
    control : std_ulogic_vector;
    field   : field_t;
    width   : positive
  ) return std_ulogic_vector is

    variable value : std_ulogic_vector(width - 1 downto 0);

  begin

    value := (others => '0');

    for i in 0 to width - 1 loop

      if (i < field.width) then
        value(i) := control(field.lsb + i);
      end if;

    end loop;

    return value;

  end function bits;

  function merged (
    mask     : std_ulogic_vector;
    repeated : std_ulogic_vector;
    streamed : std_ulogic_vector
  ) return std_ulogic_vector is

    variable word  : std_ulogic_vector(mask'length - 1 downto 0);
    variable place : natural;

  begin

    place := 0;

    for i in 0 to mask'length - 1 loop

      if (mask(i) = '1') then
        word(i) := streamed(place);
        place   := place + 1;
      else
        word(i) := repeated(i - place);
      end if;

    end loop;

    return word;

  end function merged;

  function steered (
    control : std_ulogic_vector;
    field   : address_field_t;
    width   : positive;
    parity  : std_ulogic
  ) return std_ulogic_vector is

    variable value : std_ulogic_vector(width - 1 downto 0);

  begin

    value            := bits(control, field.address, width);
    value(width - 1) := value(width - 1) xor (flag(control, field.swap) and parity);
    return value;

  end function steered;

  function chosen (
    entries : std_ulogic_vector;
    index   : std_ulogic_vector;
    width   : positive
  ) return std_ulogic_vector is

    constant COUNT  : positive := entries'length / width;
    constant GROUPS : positive := (COUNT + 3) / 4;

    variable ordinals : std_ulogic_vector(index'length - 1 downto 0);
    variable joined   : std_ulogic_vector(GROUPS * width - 1 downto 0);
    variable picked   : std_ulogic_vector(width - 1 downto 0);
    variable masked   : std_ulogic_vector(width - 1 downto 0);
    variable hits     : std_ulogic_vector(3 downto 0);
    variable ordinal  : natural;

  begin

    if (COUNT = 1) then
      return entries;
    end if;

    ordinals := index;
    hits     := "0001";

    if (index'length > 1) then
      hits(0) := not ordinals(1) and not ordinals(0);
      hits(1) := not ordinals(1) and ordinals(0);
      hits(2) := ordinals(1) and not ordinals(0);
      hits(3) := ordinals(1) and ordinals(0);
    else
      hits(0) := not ordinals(0);
      hits(1) := ordinals(0);
    end if;

    for group_index in 0 to GROUPS - 1 loop

      picked := (others => '0');

      for i in 0 to 3 loop

        ordinal := 4 * group_index + i;

        if (ordinal < COUNT) then
          masked := entries((ordinal + 1) * width - 1 downto ordinal * width) and (width - 1 downto 0 => hits(i));
          picked := picked or masked;
        end if;

      end loop;

      joined((group_index + 1) * width - 1 downto group_index * width) := picked;

    end loop;

    if (GROUPS = 1) then
      return joined;
    end if;

    return chosen(joined, ordinals(ordinals'high downto 2), width);

  end function chosen;

  function larger (
    a : integer;
    b : integer
  ) return integer is
  begin

    if (a > b) then
      return a;
    end if;

    return b;

  end function larger;

  function smallest (
    values : natural_array_t
  ) return natural is

    variable least : natural;

  begin

    least := values(values'left);

    for i in values'range loop

      if (values(i) < least) then
        least := values(i);
      end if;

    end loop;

    return least;

  end function smallest;

  function multiplier_latency (
    data_bits        : positive;
    coefficient_bits : positive
  ) return positive is
  begin

    if ((data_bits <= 25 and coefficient_bits <= 18) or (data_bits <= 18 and coefficient_bits <= 25)) then
      return 1;
    end if;

    return 3;

  end function multiplier_latency;

  function pause_word (
    latency : positive;
    deep    : boolean := false
  ) return positive is
  begin

    if (deep) then
      return latency + 9;
    end if;

    return latency + 6;

  end function pause_word;

  function trace_width (
    trace : boolean;
    pes   : positive
  ) return positive is
  begin

    if (trace) then
      return pes * TRACE_BITS + 1;
    end if;

    return 1;

  end function trace_width;

end package body pe_pkg;
