-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;
  use ieee.numeric_std.all;

library pe_lib;
  use pe_lib.pe_pkg.all;
  use pe_lib.pe_register_pkg.all;

-- Purpose:  The window of parameters, and what takes its words to the network: between two steps all stored words are read,
--           and written back with those of the window in the places of parameters.
-- Generics: Words of the window are of 32 bits, HALVES of them for a parameter. ORDER has a row for each stored word, in the
--           order in which they are replaced: its address, and above the number of its parameter plus 1, or 0.
-- Timing:   take_i begins, and tuning_o is 1 until all words have their places; no step begins meanwhile. The window must
--           not be written then. renew_i ends it, and brings back the window of the initial state.

entity pe_parameters is
  generic (
    WORD_BITS    : positive;              -- address of a word in a window
    PARAMETERS   : positive;              -- parameters
    HALVES       : positive range 1 to 2; -- words of a parameter
    STATE_BITS   : positive;              -- stored word
    ADDRESS_BITS : positive;              -- address of one
    ROWS         : positive;              -- stored words
    ORDER        : word_array_t           -- which they are
  );
  port (
    clk_i       : in    std_ulogic;                                               -- clock
    word_i      : in    std_ulogic_vector(WORD_BITS - 1 downto 0);                -- word in a window
    write_i     : in    std_ulogic;                                               -- writes it, in the window of parameters
    strobe_i    : in    std_ulogic_vector(3 downto 0);                            -- bytes that are written
    data_i      : in    std_ulogic_vector(31 downto 0);                           -- what is written
    parameter_o : out   std_ulogic_vector(31 downto 0);                           -- the word in the window of parameters
    is_param_o  : out   std_ulogic;                                               -- there is such a word
    initial_i   : in    std_ulogic_vector(32 * HALVES * PARAMETERS - 1 downto 0); -- window of the initial state
    take_i      : in    std_ulogic;                                               -- takes the words of the window
    renew_i     : in    std_ulogic;                                               -- there is the initial state
    tuning_o    : out   std_ulogic;                                               -- words are on their way
    want_o      : out   std_ulogic;                                               -- asks for access to states
    address_o   : out   std_ulogic_vector(ADDRESS_BITS - 1 downto 0);             -- state to read
    new_o       : out   std_ulogic;                                               -- another one
    give_o      : out   std_ulogic;                                               -- a new word
    given_o     : out   std_ulogic_vector(63 downto 0);                           -- it
    state_i     : in    std_ulogic_vector(63 downto 0);                           -- word that was read
    settled_i   : in    std_ulogic;                                               -- it is that of the address
    granted_i   : in    std_ulogic;                                               -- there is access
    free_i      : in    std_ulogic;                                               -- a new word can be given
    replacing_i : in    std_ulogic                                                -- some words were given, not all are in their places
  );
end entity pe_parameters;

architecture rtl of pe_parameters is

  constant WINDOW_WORDS : positive := HALVES * PARAMETERS;
  constant ROW_INDEX    : positive := larger(index_bits(ROWS), 1);
  constant NUMBER_BITS  : positive := index_bits(PARAMETERS + 1);
  constant ROW_BITS     : positive := NUMBER_BITS + ADDRESS_BITS;

  type phase_t is (resting, asking, fetching, pointing, reading, finding, giving, closing);

  type window_t is array (0 to WINDOW_WORDS - 1) of std_ulogic_vector(31 downto 0);

  signal words   : window_t                     := (others => (others => '0'));
  signal fresh   : std_ulogic                   := '1'; -- the initial state is that of the configuration
  signal phase   : phase_t                      := resting;
  signal row     : unsigned(ROW_INDEX downto 0) := (others => '0');
  signal place   : std_ulogic_vector(ROW_INDEX - 1 downto 0);
  signal line    : std_ulogic_vector(ROW_BITS - 1 downto 0);
  signal number  : unsigned(NUMBER_BITS - 1 downto 0);
  signal keep    : std_ulogic;
  signal kept    : std_ulogic_vector(STATE_BITS - 1 downto 0);
  signal give    : std_ulogic;
  signal is_last : std_ulogic;

begin

  p_window : process (clk_i) is
  begin

    if rising_edge(clk_i) then
      fresh <= '0';

      for i in 0 to WINDOW_WORDS - 1 loop

        for byte in 0 to 3 loop

          if (write_i = '1' and strobe_i(byte) = '1' and unsigned(word_i) = i) then
            words(i)(8 * byte + 7 downto 8 * byte) <= data_i(8 * byte + 7 downto 8 * byte);
          end if;

        end loop;

        if (renew_i = '1' or fresh = '1') then
          words(i) <= initial_i(32 * i + 31 downto 32 * i);
        end if;

      end loop;

    end if;

  end process p_window;

  p_parameter : process (word_i, words) is

    variable merged : std_ulogic_vector(31 downto 0);
    variable found  : std_ulogic;

  begin

    merged := (others => '0');
    found  := '0';

    for i in words'range loop

      if (unsigned(word_i) = i) then
        merged := words(i);
        found  := '1';
      end if;

    end loop;

    parameter_o <= merged;
    is_param_o  <= found;

  end process p_parameter;

  place <= std_ulogic_vector(row(ROW_INDEX - 1 downto 0));

  u_order : entity pe_lib.pe_rom
    generic map (
      CONTROL_BITS => ROW_BITS,
      PERIOD       => ROWS,
      CONTENT      => ORDER
    )
    port map (
      clk_i     => clk_i,
      fetch_i   => '1',
      address_i => place,
      control_o => line
    );

  number <= unsigned(line(ROW_BITS - 1 downto ADDRESS_BITS));

  u_kept : entity pe_lib.pe_ram
    generic map (
      WORDS     => 2 ** ROW_INDEX,
      WORD_BITS => STATE_BITS,
      IMAGE     => zeros(2 ** ROW_INDEX, STATE_BITS)
    )
    port map (
      clk_i           => clk_i,
      ce_i            => '1',
      write_enable_i  => keep,
      write_address_i => place,
      write_data_i    => state_i(STATE_BITS - 1 downto 0),
      read_enable_i   => '1',
      read_address_i  => place,
      default_i       => (others => '0'),
      read_data_o     => kept
    );

  keep    <= settled_i when phase = reading else
             '0';
  give    <= free_i when phase = giving else
             '0';
  is_last <= '1' when row = ROWS - 1 else
             '0';

  p_phase : process (clk_i) is
  begin

    if rising_edge(clk_i) then
      -- No `case`: GHDL writes it into Verilog without a default, which yosys takes for latches.
      if (phase = resting) then
        row <= (others => '0');

        if (take_i = '1') then
          phase <= asking;
        end if;
      elsif (phase = asking) then
        if (granted_i = '1') then
          phase <= fetching;
        end if;
      elsif (phase = fetching) then
        phase <= pointing;
      elsif (phase = pointing) then
        phase <= reading;
      elsif (phase = reading) then
        if (keep = '1') then
          row   <= row + 1;
          phase <= fetching;

          if (is_last = '1') then
            row   <= (others => '0');
            phase <= finding;
          end if;
        end if;
      elsif (phase = finding) then
        phase <= giving;
      elsif (phase = giving) then
        if (give = '1') then
          row   <= row + 1;
          phase <= finding;

          if (is_last = '1') then
            phase <= closing;
          end if;
        end if;
      elsif (replacing_i = '0') then
        phase <= resting;
      end if;

      if (renew_i = '1') then
        phase <= resting;
      end if;
    end if;

  end process p_phase;

  -- The kept word, or the parameter in its place.
  p_given : process (kept, number, words) is

    variable merged : std_ulogic_vector(63 downto 0);

  begin

    merged := std_ulogic_vector(resize(signed(kept), 64));

    for i in 0 to PARAMETERS - 1 loop

      if (number = i + 1) then
        merged := std_ulogic_vector(resize(signed(words(HALVES * i)), 64));

        if (HALVES = 2) then
          merged(63 downto 32) := words(HALVES * i + HALVES - 1);
        end if;
      end if;

    end loop;

    given_o <= merged;

  end process p_given;

  tuning_o  <= '0' when phase = resting else
               '1';
  want_o    <= '1' when phase = asking or phase = fetching or phase = pointing or phase = reading or phase = finding
                        or phase = giving else
               '0';
  address_o <= line(ADDRESS_BITS - 1 downto 0);
  new_o     <= '1' when phase = pointing or phase = closing else
               '0';
  give_o    <= give;

end architecture rtl;
