-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;
  use ieee.numeric_std.all;

library pe_lib;
  use pe_lib.pe_pkg.all;
  use pe_lib.pe_write_pkg.all;

-- Purpose:  One processing element: multiplies stored words by coefficients, accumulates the products, scales the sum,
--           stores it and sends it to other PEs, as its control words say.
-- Generics: The number of words of a memory is a power of two, or 0 where allowed; images have as many words. The
--           features (FACTOR to SEND, SHIFTS, INDEX_WORDS) decide which fields the control word has, and so
--           CONTROL_BITS.
-- Timing:   Each group of the control word acts in the clock in which the word is in the control register;
--           docs/hardware.md, "Timing", gives the distances between the groups of one operation. All registers hold in
--           clocks without advance_i. With DEEP the sequencer's control signals arrive one clock before the word.

entity pe is
  generic (
    WORD_BITS        : positive;         -- stored word, guard bits included
    DATA_BITS        : positive;         -- data port of the multiplier
    COEFFICIENT_BITS : positive;         -- coefficient port of the multiplier
    CONTROL_BITS     : positive;         -- control word
    OWN_WORDS        : positive;         -- own memory, a power of two
    BASE_WORDS       : positive;         -- base memory, a power of two
    COEFF_WORDS      : natural;          -- coefficient memory, 0 or a power of two
    IMPORTED_WORDS   : natural;          -- imported memory, 0 or a power of two
    PORT_COUNT       : natural;          -- input ports
    SHIFTS           : natural_array_t;  -- right shifts of the write side
    ACCUMULATOR_BITS : positive;         -- running sum
    FACTOR           : boolean;          -- products of two stored words
    PRE_ADDER        : boolean;          -- sums of an own and an imported operand
    SWAP             : boolean;          -- buffers that change roles
    BASE_LAST        : boolean;          -- base memory is written in the last round only
    SEND             : boolean;          -- link register
    OWN_IMAGE        : word_array_t;     -- initial own memory
    BASE_IMAGE       : word_array_t;     -- initial base memory
    COEFF_IMAGE      : word_array_t;     -- initial coefficient memory
    IMPORTED_IMAGE   : word_array_t;     -- initial imported memory
    INDEX_WORDS      : natural := 0;     -- index memory, 0 or a power of two
    INDEX_WIDTH      : natural := 0;     -- bits of an index
    OCTAVE_WIDTH     : natural := 0;     -- bits of an index that count octaves, 0 if none do
    SATURATE         : boolean := true;  -- clamps words that are out of range; false if it is proven that none can be
    ACCESS_STATES    : boolean := false; -- states can be read and replaced
    SPLIT_FLAGS      : boolean := false; -- a flag of its own for operands that are too large
    SHOWS            : boolean := false; -- has an output memory
    SHOW_LAST        : boolean := false; -- which takes words of the last round only
    RING_BITS        : natural := 0;     -- bits that count the words of a ring, 0 without rings
    DEEP             : boolean := false; -- registers behind memories and shifts
    TRACE            : boolean := false  -- drives trace_o
  );
  port (
    clk_i      : in    std_ulogic;                                                                -- clock
    advance_i  : in    std_ulogic;                                                                -- executes the control word
    settle_i   : in    std_ulogic;                                                                -- first pass: memories keep their images
    parity_i   : in    std_ulogic;                                                                -- 1 in odd rounds
    last_i     : in    std_ulogic;                                                                -- writes belong to the last round
    turn_i     : in    std_ulogic_vector(larger(RING_BITS, 1) - 1 downto 0)   := (others => '0'); -- number of the step
    control_i  : in    std_ulogic_vector(CONTROL_BITS - 1 downto 0);                              -- control register
    ports_i    : in    std_ulogic_vector(larger(PORT_COUNT, 1) * DATA_BITS - 1 downto 0);         -- port 0 rightmost
    clear_i    : in    std_ulogic                                             := '0';             -- clears the flags
    refill_i   : in    std_ulogic                                             := '0';             -- the pipeline is filled anew
    replace_i  : in    std_ulogic                                             := '0';             -- states are replaced
    look_i     : in    std_ulogic                                             := '0';             -- states are read
    here_i     : in    std_ulogic                                             := '0';             -- a state of this PE is
    place_i    : in    std_ulogic_vector(index_bits(BASE_WORDS) - 1 downto 0) := (others => '0'); -- base word to read
    state_i    : in    std_ulogic_vector(WORD_BITS downto 0)                  := (others => '0'); -- replacement less the offset
    state_o    : out   std_ulogic_vector(WORD_BITS - 1 downto 0);                                 -- word that was read
    link_o     : out   std_ulogic_vector(DATA_BITS - 1 downto 0);                                 -- link register
    word_o     : out   std_ulogic_vector(WORD_BITS - 1 downto 0);                                 -- word of the write group
    show_o     : out   std_ulogic;                                                                -- the output memory takes it
    overflow_o : out   std_ulogic;                                                                -- sticky: a written word saturated
    operands_o : out   std_ulogic;                                                                -- sticky: operands too large for a sum, with SPLIT_FLAGS
    trace_o    : out   std_ulogic_vector(TRACE_BITS - 1 downto 0)                                 -- memory writes, for test benches
  );
end entity pe;

architecture rtl of pe is

  -- An address and a value in their fields of the trace.

  function traced (
    address : unsigned
  ) return std_ulogic_vector is
  begin

    return std_ulogic_vector(resize(address, TRACE_ADDRESS_BITS));

  end function traced;

  function traced (
    value : signed
  ) return std_ulogic_vector is
  begin

    return std_ulogic_vector(resize(value, TRACE_VALUE_BITS));

  end function traced;

  constant LAYOUT : layout_t := control_layout(OWN_WORDS, BASE_WORDS, COEFF_WORDS, IMPORTED_WORDS, PORT_COUNT,
                                               SHIFTS'length, COEFFICIENT_BITS, FACTOR, SWAP, SEND, INDEX_WORDS,
                                               OCTAVE_WIDTH > 0, SHOWS, RING_BITS > 0);

  constant OWN_BITS   : positive := index_bits(OWN_WORDS);
  constant BASE_BITS  : positive := index_bits(BASE_WORDS);
  constant WRITE_BITS : positive := index_bits(write_words(OWN_WORDS, BASE_WORDS, COEFF_WORDS, FACTOR));

  constant PADDED_BITS : positive := larger(ACCUMULATOR_BITS, DATA_BITS + COEFFICIENT_BITS);

  -- Where nothing can be out of range there is a flag in simulation only, where it stops the run.
  constant FLAGGED : boolean := SATURATE or TRACE;

  -- Rings in the own memory, if it is as large as one.
  constant OWN_RING_BITS : natural := smallest((RING_BITS, OWN_BITS));

  -- What the sequencer tells
  signal advance : std_ulogic;
  signal settle  : std_ulogic;
  signal parity  : std_ulogic;
  signal last    : std_ulogic;

  -- Operand group
  signal own_operand         : std_ulogic_vector(DATA_BITS - 1 downto 0);
  signal imported_operand    : std_ulogic_vector(DATA_BITS - 1 downto 0);
  signal coefficient_operand : std_ulogic_vector(COEFFICIENT_BITS - 1 downto 0);
  signal too_large           : std_ulogic;
  signal own_enable          : std_ulogic;
  signal imported_enable     : std_ulogic;

  -- Accumulate group
  signal product     : signed(DATA_BITS + COEFFICIENT_BITS - 1 downto 0);
  signal accumulator : signed(ACCUMULATOR_BITS - 1 downto 0) := (others => '0');
  signal hold        : signed(ACCUMULATOR_BITS - 1 downto 0) := (others => '0');

  -- Scale group
  signal word      : std_ulogic_vector(WORD_BITS - 1 downto 0);
  signal saturated : std_ulogic;

  -- Write group
  signal write_own     : std_ulogic;
  signal write_base    : std_ulogic;
  signal write_factor  : std_ulogic;
  signal write_index   : std_ulogic;
  signal base_round    : std_ulogic;
  signal write_plain   : std_ulogic_vector(WRITE_BITS - 1 downto 0);
  signal write_steered : std_ulogic_vector(WRITE_BITS - 1 downto 0);
  signal write_address : std_ulogic_vector(WRITE_BITS - 1 downto 0);
  signal link          : std_ulogic_vector(DATA_BITS - 1 downto 0) := (others => '0');
  signal overflow      : std_ulogic                                := '0';
  signal operands      : std_ulogic                                := '0';

  -- What a state is replaced by
  signal replacement : std_ulogic_vector(WORD_BITS downto 0) := (others => '0');

begin

  assert LAYOUT.bits = CONTROL_BITS
    report "pe: control words have " & integer'image(CONTROL_BITS) & " bits, the features need "
           & integer'image(LAYOUT.bits)
    severity failure;

  assert DATA_BITS <= WORD_BITS and COEFFICIENT_BITS <= WORD_BITS
    report "pe: the ports of the multiplier take no more than the WORD_BITS of a word"
    severity failure;

  assert (COEFF_WORDS > 0 or not FACTOR) and (IMPORTED_WORDS > 0 or not PRE_ADDER)
    report "pe: FACTOR needs a coefficient memory, PRE_ADDER an imported one"
    severity failure;

  assert IMPORTED_WORDS = 0 or PORT_COUNT > 0
    report "pe: an imported memory needs a port"
    severity failure;

  -- Sequencer -----------------------------------------------------------------------------------------------------

  g_told : if not DEEP generate

    advance <= advance_i;
    settle  <= settle_i;
    parity  <= parity_i;
    last    <= last_i;

  end generate g_told;

  g_replicated : if DEEP generate

    u_advance : entity pe_lib.pe_replica
      generic map (
        WIDTH => 2
      )
      port map (
        clk_i      => clk_i,
        value_i(1) => advance_i,
        value_i(0) => settle_i,
        value_o(1) => advance,
        value_o(0) => settle
      );

    g_parity : if SWAP generate

      u_parity : entity pe_lib.pe_replica
        generic map (
          WIDTH => 1
        )
        port map (
          clk_i      => clk_i,
          value_i(0) => parity_i,
          value_o(0) => parity
        );

    end generate g_parity;

    g_no_parity : if not SWAP generate

      parity <= '0';

    end generate g_no_parity;

    g_last : if BASE_LAST or SHOW_LAST generate

      u_last : entity pe_lib.pe_replica
        generic map (
          WIDTH => 1
        )
        port map (
          clk_i      => clk_i,
          value_i(0) => last_i,
          value_o(0) => last
        );

    end generate g_last;

    g_no_last : if not BASE_LAST and not SHOW_LAST generate

      last <= '0';

    end generate g_no_last;

  end generate g_replicated;

  -- Operand group -------------------------------------------------------------------------------------------------

  -- Where states are replaced all products are 0.
  own_enable      <= flag(control_i, LAYOUT.own.enable) and not replace_i;
  imported_enable <= flag(control_i, LAYOUT.imported.enable) and not replace_i when IMPORTED_WORDS > 0 else
                     '0';

  u_own_operand : entity pe_lib.pe_ram
    generic map (
      WORDS     => OWN_WORDS,
      WORD_BITS => DATA_BITS,
      IMAGE     => OWN_IMAGE,
      DEEP      => DEEP
    )
    port map (
      clk_i           => clk_i,
      ce_i            => advance,
      write_enable_i  => write_own,
      write_address_i => write_address(OWN_BITS - 1 downto 0),
      write_data_i    => word(WORD_BITS - 1 downto WORD_BITS - DATA_BITS),
      read_enable_i   => own_enable,
      read_address_i  => turned(steered(control_i, LAYOUT.own, OWN_BITS, parity),
                                flag(control_i, LAYOUT.own.ring), turn_i, OWN_RING_BITS),
      default_i       => (others => '0'),
      read_data_o     => own_operand
    );

  u_coefficient : entity pe_lib.pe_coefficient
    generic map (
      WORD_BITS        => WORD_BITS,
      COEFFICIENT_BITS => COEFFICIENT_BITS,
      CONTROL_BITS     => CONTROL_BITS,
      LAYOUT           => LAYOUT,
      COEFF_WORDS      => COEFF_WORDS,
      WRITE_BITS       => WRITE_BITS,
      FACTOR           => FACTOR,
      COEFF_IMAGE      => COEFF_IMAGE,
      DEEP             => DEEP
    )
    port map (
      clk_i           => clk_i,
      advance_i       => advance,
      control_i       => control_i,
      write_i         => write_factor,
      write_address_i => write_plain,
      word_i          => word,
      coefficient_o   => coefficient_operand
    );

  u_multiplier : entity pe_lib.pe_multiplier
    generic map (
      DATA_BITS        => DATA_BITS,
      COEFFICIENT_BITS => COEFFICIENT_BITS,
      LATENCY          => multiplier_latency(DATA_BITS, COEFFICIENT_BITS),
      PRE_ADDER        => PRE_ADDER,
      DEEP             => DEEP
    )
    port map (
      clk_i         => clk_i,
      ce_i          => advance,
      own_i         => signed(own_operand),
      imported_i    => signed(imported_operand),
      coefficient_i => signed(coefficient_operand),
      product_o     => product
    );

  -- A sum of two operands fits the data port if both are within half of full scale.

  g_pre_adder : if PRE_ADDER generate

    signal both     : std_ulogic := '0';
    signal follower : std_ulogic := '0';
    signal checked  : std_ulogic;

  begin

    p_both : process (clk_i) is
    begin

      if rising_edge(clk_i) then
        if (advance = '1') then
          both     <= flag(control_i, LAYOUT.own.enable) and flag(control_i, LAYOUT.imported.enable);
          follower <= both;
        end if;
      end if;

    end process p_both;

    checked <= follower when DEEP else
               both;

    too_large <= checked and ((own_operand(DATA_BITS - 1) xor own_operand(DATA_BITS - 2))
                              or (imported_operand(DATA_BITS - 1) xor imported_operand(DATA_BITS - 2)));

  end generate g_pre_adder;

  g_single_operand : if not PRE_ADDER generate

    too_large <= '0';

  end generate g_single_operand;

  -- Accumulate group ----------------------------------------------------------------------------------------------

  p_accumulate : process (clk_i) is

    variable kept : signed(ACCUMULATOR_BITS - 1 downto 0);

  begin

    if rising_edge(clk_i) then
      if (advance = '1') then
        -- The feedback must be on the else branch: yosys 0.70 inverts the select of the other form.
        if (flag(control_i, LAYOUT.close) = '1') then
          kept := (others => '0');
        else
          kept := accumulator;
        end if;

        accumulator <= kept + resize(product, PADDED_BITS)(ACCUMULATOR_BITS - 1 downto 0);

        if (flag(control_i, LAYOUT.close) = '1') then
          hold <= accumulator;
        end if;
      end if;

      if (ACCESS_STATES and refill_i = '1') then
        accumulator <= (others => '0');
      end if;
    end if;

  end process p_accumulate;

  -- Scale group ---------------------------------------------------------------------------------------------------

  u_scale : entity pe_lib.pe_scale
    generic map (
      WORD_BITS        => WORD_BITS,
      DATA_BITS        => DATA_BITS,
      COEFFICIENT_BITS => COEFFICIENT_BITS,
      CONTROL_BITS     => CONTROL_BITS,
      LAYOUT           => LAYOUT,
      BASE_WORDS       => BASE_WORDS,
      SHIFTS           => SHIFTS,
      ACCUMULATOR_BITS => ACCUMULATOR_BITS,
      BASE_IMAGE       => BASE_IMAGE,
      INDEX_WORDS      => INDEX_WORDS,
      INDEX_WIDTH      => INDEX_WIDTH,
      OCTAVE_WIDTH     => OCTAVE_WIDTH,
      SATURATE         => SATURATE,
      ACCESS_STATES    => ACCESS_STATES,
      DEEP             => DEEP
    )
    port map (
      clk_i           => clk_i,
      advance_i       => advance,
      control_i       => control_i,
      hold_i          => hold,
      write_base_i    => write_base,
      write_index_i   => write_index,
      write_address_i => write_plain(BASE_BITS - 1 downto 0),
      replace_i       => replace_i,
      replacement_i   => replacement,
      look_i          => look_i,
      look_here_i     => here_i,
      look_address_i  => place_i,
      base_o          => state_o,
      word_o          => word,
      saturated_o     => saturated
    );

  g_replacement : if ACCESS_STATES generate

    p_replacement : process (clk_i) is
    begin

      if rising_edge(clk_i) then
        if (replace_i = '0') then
          replacement <= (others => '0');
        elsif (here_i = '1') then
          replacement <= state_i;
        end if;
      end if;

    end process p_replacement;

  end generate g_replacement;

  -- Write group ---------------------------------------------------------------------------------------------------

  base_round <= last when BASE_LAST else
                '1';

  write_own    <= flag(control_i, LAYOUT.write_own) and not settle;
  write_base   <= flag(control_i, LAYOUT.write_base) and not settle and base_round;
  write_factor <= flag(control_i, LAYOUT.write_factor) and not settle;
  write_index  <= flag(control_i, LAYOUT.write_index) and not settle when INDEX_WORDS > 0 else
                  '0';

  -- Only the own memory has pairs and rings.
  write_plain <= bits(control_i, LAYOUT.write.address, WRITE_BITS);

  p_write_address : process (control_i, write_plain, parity) is
  begin

    write_steered               <= write_plain;
    write_steered(OWN_BITS - 1) <= write_plain(OWN_BITS - 1)
                                   xor (flag(control_i, LAYOUT.write.swap) and parity);

  end process p_write_address;

  write_address <= turned(write_steered, flag(control_i, LAYOUT.write.ring), turn_i, OWN_RING_BITS);

  p_flag : process (clk_i) is
  begin

    if rising_edge(clk_i) then
      if (clear_i = '1') then
        overflow <= '0';
        operands <= '0';
      end if;

      if (advance = '1') then
        -- A value that is only sent must not saturate unseen either.
        if (FLAGGED and saturated = '1'
            and (write_own = '1' or write_base = '1' or write_factor = '1' or write_index = '1'
                 or (flag(control_i, LAYOUT.send) = '1' and settle = '0'))) then
          assert SATURATE
            report "pe: a word is out of range, which was proven impossible"
            severity failure;
          overflow <= '1';
        end if;

        if (FLAGGED and too_large = '1' and settle = '0') then
          assert SATURATE
            report "pe: an operand is too large for a sum, which was proven impossible"
            severity failure;

          if (SPLIT_FLAGS) then
            operands <= '1';
          else
            overflow <= '1';
          end if;
        end if;
      end if;
    end if;

  end process p_flag;

  g_link : if SEND generate

    p_link : process (clk_i) is
    begin

      if rising_edge(clk_i) then
        if (advance = '1') then
          if (flag(control_i, LAYOUT.send) = '1') then
            link <= word(WORD_BITS - 1 downto WORD_BITS - DATA_BITS);
          end if;
        end if;
      end if;

    end process p_link;

  end generate g_link;

  link_o     <= link;
  word_o     <= word;
  show_o     <= '0' when not SHOWS else
                advance and flag(control_i, LAYOUT.show) and last when SHOW_LAST else
                advance and flag(control_i, LAYOUT.show);
  overflow_o <= overflow;
  operands_o <= operands;

  -- Receive group -------------------------------------------------------------------------------------------------

  g_imported : if IMPORTED_WORDS > 0 generate

    constant IMPORTED_BITS : positive := larger(index_bits(IMPORTED_WORDS), 1);
    constant PORT_BITS     : positive := larger(index_bits(PORT_COUNT), 1);

    -- Rings, if the memory is as large as one.
    constant IMPORTED_RING_BITS : natural := smallest((RING_BITS, IMPORTED_BITS));

    signal receive_enable  : std_ulogic;
    signal receive_address : std_ulogic_vector(IMPORTED_BITS - 1 downto 0);
    signal received        : std_ulogic_vector(DATA_BITS - 1 downto 0);

  begin

    receive_enable  <= flag(control_i, LAYOUT.receive.enable) and not settle;
    receive_address <= turned(steered(control_i, LAYOUT.receive, IMPORTED_BITS, parity),
                              flag(control_i, LAYOUT.receive.ring), turn_i, IMPORTED_RING_BITS);
    received        <= chosen(ports_i, bits(control_i, LAYOUT.port_index, PORT_BITS), DATA_BITS);

    u_imported_operand : entity pe_lib.pe_ram
      generic map (
        WORDS     => IMPORTED_WORDS,
        WORD_BITS => DATA_BITS,
        IMAGE     => IMPORTED_IMAGE,
        DEEP      => DEEP
      )
      port map (
        clk_i           => clk_i,
        ce_i            => advance,
        write_enable_i  => receive_enable,
        write_address_i => receive_address,
        write_data_i    => received,
        read_enable_i   => imported_enable,
        read_address_i  => turned(steered(control_i, LAYOUT.imported, IMPORTED_BITS, parity),
                                  flag(control_i, LAYOUT.imported.ring), turn_i, IMPORTED_RING_BITS),
        default_i       => (others => '0'),
        read_data_o     => imported_operand
      );

    g_trace_imported : if TRACE generate

      trace_o(TRACE_IMPORTED_WRITE)                                   <= receive_enable;
      trace_o(TRACE_IMPORTED_WRITE - 1 downto TRACE_IMPORTED_ADDRESS) <= traced(unsigned(receive_address));
      trace_o(TRACE_IMPORTED_ADDRESS - 1 downto TRACE_IMPORTED_VALUE) <= traced(signed(received));

    end generate g_trace_imported;

  end generate g_imported;

  g_alone : if IMPORTED_WORDS = 0 generate

    imported_operand                      <= (others => '0');
    trace_o(TRACE_OWN_VALUE - 1 downto 0) <= (others => '0');

  end generate g_alone;

  -- Trace ---------------------------------------------------------------------------------------------------------

  g_trace : if TRACE generate

    trace_o(TRACE_OVERFLOW)                               <= overflow or operands;
    trace_o(TRACE_OWN_WRITE)                              <= write_own or write_base or write_factor;
    trace_o(TRACE_OWN_WRITE - 1 downto TRACE_OWN_ADDRESS) <= traced(unsigned(write_address));
    trace_o(TRACE_OWN_ADDRESS - 1 downto TRACE_OWN_VALUE) <= traced(signed(word));

  end generate g_trace;

  g_silent : if not TRACE generate

    trace_o(TRACE_BITS - 1 downto TRACE_OWN_VALUE) <= (others => '0');

    g_silent_imported : if IMPORTED_WORDS > 0 generate

      trace_o(TRACE_OWN_VALUE - 1 downto 0) <= (others => '0');

    end generate g_silent_imported;

  end generate g_silent;

end architecture rtl;
